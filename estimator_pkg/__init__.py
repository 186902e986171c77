"""Live velocity estimation for ROS 2: observers, their nodes, bags and evaluation.

The rooms, and what each may know:

``observers``   the mathematics of each observer. No ROS, no files, no plotting.
``models``      mechanical and motor models that model-based observers need.
``driver``      takes a stream of samples through guard and observer: live, replay and tuning.
``messages``    CDR bytes of the few message types we handle, decoded and encoded without ROS.
``nodes``       ROS 2 nodes. No mathematics.
``bags``        reading, writing, recording, playing and replaying of bags.
``evaluation``  reference velocity, metrics, comparison.
``cli``         the command line, which finds its commands through entry points.
"""

__version__ = '0.1.0'
