"""Programs that answer a case folder: `python ADAPTER.py CASE RESULT.npz`, each with its own law.

They import nothing of palpate, so that they run in the interpreter that has their tool.
"""
