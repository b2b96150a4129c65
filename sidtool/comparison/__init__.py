"""Comparison of a SID with another SID or with a table of reference numbers.

block_differences   every block, frequencies, deflections, responses, mode shapes
comparison          all of them; reference tables; results as data
"""
