"""Training of a small vision-language model for one simulated domain, from scratch (`executive train`)."""

from executive.util.native_libraries import keep_triton_apart

keep_triton_apart()  # these modules import torch as they are imported
