"""From solutions to checks and a verdict, and the files that report them."""
