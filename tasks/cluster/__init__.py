"""Studies on a cluster: the profile of a site, submission, and the doctor."""
