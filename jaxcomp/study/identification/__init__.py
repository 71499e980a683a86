"""Identification: unknown constants of a machine, fitted to measurements with their errors."""
