"""What is studied: the study file, measured curves, the tissue model, simulators, and a folder for each task."""
