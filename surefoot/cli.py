"""The command line; replaced when the verbs arrive."""


def main() -> None:
    """Entry point."""
