"""The hidden state of the farm: epidemics and soil humidity over days."""
