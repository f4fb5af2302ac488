"""The controller in single precision on emulated microcontrollers."""
