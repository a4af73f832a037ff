"""Square-root sigma-point filtering, its models, and its consistency."""
