"""The live page: a body is seen and touched, and several simulators follow the same pointer."""
