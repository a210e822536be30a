"""Choose gains within bounds that minimise a stated objective, over a set of plants.

objective   ``ise + 0.01*max_abs_v`` -> a weighted sum of a sweep's metrics of a run
gains       which gains are searched, within which bounds; filter gains via the poles of A0
request     model and settings -> Request, checked
cost        many designs -> one number each, by one call of the batch library; always finite
search      differential evolution over the designs; the result depends only on the seed
rewrite     a model file's text with other gains and another name, comments kept
comparison  the design before and after, run by run
figure      both designs drawn
"""

from pmjoint_codegen.called import make_callable

make_callable(__name__)  # `pmjoint_codegen.tune(...)`: see `studies.tune`
