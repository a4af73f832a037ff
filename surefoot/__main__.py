"""`python -m surefoot` is `surefoot`."""

from .cli import main

main(prog_name="surefoot")
