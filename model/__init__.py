"""The physics: parameters, ropes, vehicle, winches, disturbances, references, and the plant composed of them."""
