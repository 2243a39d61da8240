"""Fits: the parameters with which scenes move as measured."""
