"""`python -m deepring`: the command line."""

from deepring.cli.main import main

if __name__ == "__main__":
    main()
