"""One file per paper: its figures and tables, ours beside the printed ones."""
