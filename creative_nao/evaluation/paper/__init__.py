"""The reproduction of the paper: `creative-nao evaluate paper`.

Its course
    - `run.reproduce`: from the networks to the page. `settings.py`: what is reproduced. `bank.py`: the networks.
    - `measuring.py`: one network's figures, with `learning.py`, `terrain.py` and `combinations.py`.
    - `summary.py`: means over networks. `reference.py`: the paper's own figures.
What follows from it
    - `claims.py`: the paper's conclusions and what decides each, by the rules of `comparisons.py`.
    - `sensitivity.py`: what depends on which open choice; `variants.py` lists them, `rescoring.py` scores anew.
How it is told
    - `page.py` and `sensitivity_page.py`, in the words of `wording.py`, written by `blocks.py`; `publishing.py`.
    - `gallery.py`: all figures, from `curves.py`, `movements.py` and `maps.py`.
"""
