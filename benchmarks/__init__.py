"""Measurements that run as separate commands and are not part of the tests."""
