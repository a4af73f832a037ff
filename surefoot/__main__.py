"""`python -m surefoot` is `surefoot`."""

from .cli.main import main

main(prog_name="surefoot")
