"""The works of the benchmark, a module each: its contenders, its title, what is asked of it.

A module holds `TITLE`, `CONTENDERS` (name: a function without arguments that prepares it) and `asked(results)`, the
rows of its targets from what was measured.
"""
