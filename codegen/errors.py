"""The family of errors; every message is one line with the cause and a remedy."""


class DualwinchError(Exception):
    """Base of all deliberate errors of this project."""


class CodegenError(DualwinchError):
    """CasADi cannot generate C for a function."""


class CompilerNotFoundError(DualwinchError):
    """No C compiler on this machine."""


class CompileError(DualwinchError):
    """The C compiler failed."""


class CacheError(DualwinchError):
    """The folder of compiled libraries cannot be used."""


class CodegenWarning(UserWarning):
    """CasADi's own C is used, as the emitter lacks an operation."""


class CacheWarning(UserWarning):
    """The folder of compiled libraries cannot be trusted and is replaced by another."""


def installing(extra: str) -> str:
    """Commands in messages to install an optional dependency: by pip, or by uv, whose environments lack pip."""
    return f"pip install 'dualwinch[{extra}]', or uv run --extra {extra} ..."
