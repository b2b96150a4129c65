"""Radau IIA methods: their stages and their passing of events."""
