"""The study file, validated, and the open result folder that every task works in."""
