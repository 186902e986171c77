"""``bench speed``: the live nodes over real DDS, beside a node that only republishes."""
