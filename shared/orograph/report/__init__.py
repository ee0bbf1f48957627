"""From what a run left behind to its score, its pictures and its report; pure functions except `folder`, which reads and writes."""
