"""``bench speed``: the live nodes over real DDS, compared with a node that only republishes."""
