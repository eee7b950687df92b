"""Cohorts with a hidden effect, made by another integration than the project's and in other forms than its library's.

``python -m tests.hidden --out FOLDER --cases 24 --seed 7`` writes a folder for ``sinew benchmark discover``.
"""
