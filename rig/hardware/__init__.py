"""The hardware in millimetres and millinewtons; volts stop here."""
