"""Names of the codegen that other packages use, by the module that defines them."""

from .c import (
    Argument as Argument,
    SCALAR_EXPRESSIONS as SCALAR_EXPRESSIONS,
    REAL_DEFINITIONS as REAL_DEFINITIONS,
    SIGN_FUNCTION as SIGN_FUNCTION,
    c_literal as c_literal,
    write_function as write_function,
)
from .namespace import (
    NUMPY as NUMPY,
    Namespace as Namespace,
    casadi_namespace as casadi_namespace,
    namespace_of as namespace_of,
)
from .vectorised import (
    Layout as Layout,
    VectorisedFunction as VectorisedFunction,
    call as call,
    dense_function as dense_function,
)
