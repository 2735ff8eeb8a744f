"""Programs that train policies by Stable-Baselines3, and judge and plot what they learned."""
