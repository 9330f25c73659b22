"""ActorsNeRF and its renderer in plain torch: read `actorsnerf` and `render` first."""
