"""Where what tests read stands in the repository."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SLIDER_CRANK = EXAMPLES / "slider_crank"
