"""What is simulated, as frozen data; knows no solver."""
