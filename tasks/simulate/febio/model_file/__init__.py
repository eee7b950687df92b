"""A FEBio model as its author saved it (``model.feb``): what it holds, and the template and study made of it."""
