"""Reproductions of the papers: figures and tables, our results next to the printed ones."""
