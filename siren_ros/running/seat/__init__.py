"""Drives the AV under test without another program: what its driver sees, its way, its pedals and wheel."""
