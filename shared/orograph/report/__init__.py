"""From what a run left behind to its score, its pictures and its report; only `folder` and `reference` touch files."""
