"""Write docs/environments.md from the docstrings of the environments.

python docs/make_environments.py
"""

from pathlib import Path

from creative_nao.envs.pages import environments_page

if __name__ == "__main__":
    Path(__file__).with_name("environments.md").write_text(environments_page(), encoding="utf-8")
