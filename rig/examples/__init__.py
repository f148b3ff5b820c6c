"""Rig and protocol files with every key explained; `indenter run --example DIR` copies them."""
