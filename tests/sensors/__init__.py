"""Tests of the service's own sensors."""
