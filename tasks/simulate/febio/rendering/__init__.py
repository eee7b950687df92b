"""The program that reads and renders templates. It runs in a process of its own; nobody imports it to render.

Its modules import nothing of sinew but each other, so that it starts in a tenth of a second.
"""
