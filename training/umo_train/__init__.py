"""Trains umo's models: the recipe of the UMo paper, the data of the default model, converters and metrics."""
