"""Measures of movements: NumPy arrays in, numbers out."""
