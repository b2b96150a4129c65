"""From a function in Python to a kernel: values, records, machine code, its storage."""
