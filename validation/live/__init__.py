"""A live page: a body that is seen and touched, by several simulators under the same hand."""
