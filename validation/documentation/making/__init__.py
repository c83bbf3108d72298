"""Makes the pages of the documentation that come from the code, and runs what its pages show.

    PYTHONPATH=validation/documentation python -m making FOLDER

FOLDER is a copy of the documentation's folder, from which Sphinx builds (.ci/docs.sh).
"""
