"""What is left, where, and which physics it is: tests, hypotheses, their proof and the joint fit."""
