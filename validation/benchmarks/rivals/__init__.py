"""Rivals of the benchmarks: files that run alone, in a child process, with any interpreter.

Each has `prepare(body)`, which imports what it times, and returns an object with

    tool, version, precision    text
    force                       internal force at the body's test displacement, or None
    advance(num_steps)          does the work; may return more columns for the row

They import nothing of palpate (`palpate_*` excepted): the interpreter that has a rival need not
have palpate. `prepare` raises ImportError where its tool is not installed, and ValueError where
the body is not for it.
"""
