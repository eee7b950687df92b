"""What is studied: study files, measured curves, the tissue model, simulators, and one module for each task."""
