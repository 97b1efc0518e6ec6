"""The study is shown in the viewer: arm, errors, the worst poses, training."""
