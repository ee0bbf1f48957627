"""From what a run left behind to its score and its checks, without a picture."""
