"""Measurements that are commands of their own, not part of the tests."""
