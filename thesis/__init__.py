"""The tables, figures and experiments of the thesis that flockstep implements: `./dev thesis [NAME...]`."""
