"""How often a discovery is right: cohorts with known answers are run blind, and scored afterwards."""
