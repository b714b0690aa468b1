"""A robot invents movements of its own, and its creativity is measured."""
