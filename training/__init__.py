"""Programs that train policies with Stable-Baselines3, and evaluate and plot them."""
