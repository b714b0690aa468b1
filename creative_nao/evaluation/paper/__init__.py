"""The reproduction of the paper: `creative-nao evaluate paper`; `run.reproduce` does all of it."""
