"""The trial file: layout, writer, reader, importers."""
