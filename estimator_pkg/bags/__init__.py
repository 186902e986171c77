"""Reading, writing, recording, playing and replaying of bags."""
