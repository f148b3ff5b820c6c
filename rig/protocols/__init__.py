"""Protocols as data: what a file may say, the steps it becomes, and the pure judgements made on the way."""
