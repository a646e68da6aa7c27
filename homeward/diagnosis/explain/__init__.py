"""Which physics the residual of a refit lacks: tests of it, hypotheses, their validation and the
joint fit."""
