"""Simulate a scene."""
