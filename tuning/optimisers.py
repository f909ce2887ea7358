"""Any optimiser of optax, by its name."""

import difflib
import inspect

import jax.numpy as jnp
import optax


def make_optimiser(name: str) -> optax.GradientTransformation:
    """The optimiser of optax of this name, with a learning rate of one.

    Args:
        name: as `adam`, `rmsprop` or `lion`.

    Raises:
        ValueError: optax has none of this name that needs a gradient alone.
    """
    make = getattr(optax, name, None)
    if callable(make) and "learning_rate" in _parameters(make):
        try:
            optimiser = make(learning_rate=1.0)
            at = jnp.zeros(2)
            optimiser.update(at, optimiser.init(at), at)
        except TypeError:
            pass
        else:
            return optimiser
    known = [
        n
        for n in dir(optax)
        if n.islower()
        and n != name
        and "learning_rate" in _parameters(getattr(optax, n))
    ]
    near = difflib.get_close_matches(name, known, 3) or ["adam", "rmsprop", "sgd"]
    raise ValueError(
        "optimizer must be one of optax that needs nothing but a gradient and a "
        f"learning rate, as {', '.join(near)}; received {name!r}."
    )


def _parameters(thing: object) -> tuple[str, ...]:
    if not callable(thing):
        return ()
    try:
        return tuple(inspect.signature(thing).parameters)
    except (TypeError, ValueError):
        return ()
