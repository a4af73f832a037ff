"""`python -m surefoot` is `surefoot`."""

from .cli.main import main

if __name__ == "__main__":
    main(prog_name="surefoot")
