"""Names of the codegen that other packages use, by the module that defines them."""

from .c import (
    Argument as Argument,
    PLAIN as PLAIN,
    REAL as REAL,
    SIGN as SIGN,
    literal as literal,
    write_function as write_function,
)
from .namespace import (
    NUMPY as NUMPY,
    Namespace as Namespace,
    casadi_namespace as casadi_namespace,
    namespace_of as namespace_of,
)
from .vectorised import Layout as Layout, Vectorised as Vectorised, call as call, dense as dense
