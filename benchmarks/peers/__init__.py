"""The same closed loop outside jaxglider, to be measured against.

FxTPPC with its observer on the small-angle glider with the paper's actuation, steered
by a schedule of attitudes. Every peer that takes plain arrays has one function

    evaluate(problem, parameters, ticks, cores) -> metrics

with `parameters` of shape (parameters, members) and metrics of shape
(len(METRICS), members), both in the precision they are handed in.
"""
