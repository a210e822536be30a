"""The paper, equation by equation: what it prints beside what follows from its model.

notation     printed text -> SymPy, and printed text -> LaTeX in the printed order
paper        the printed equations (1)-(37), and nothing else
context      what the printed equations are checked against: the derivation, the physics, one symbol table
judgement    verdicts by comparison: equalities, inequalities, chains of both
findings     the record that every examination ends in
modelling, filtering, designing, stability, claims    one function an equation or claim
runs         closed-loop runs that the claims are tested with
examination  the driver: all findings in the paper's order
report       findings as a terminal table, Markdown and JSON
"""
