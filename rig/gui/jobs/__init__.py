"""What the window's worker process does for its pages: files, fits, figures. Nothing here imports Qt."""
