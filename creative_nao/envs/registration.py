"""Registration of the environments with Gymnasium, by strings, so that nothing heavy is loaded."""

from __future__ import annotations

_MODULE = "creative_nao.envs.boxing_envs"

ENVIRONMENTS = {
    "CreativeNao/Boxing-v0": f"{_MODULE}:BoxingEnv",
    "CreativeNao/BoxingMental-v0": f"{_MODULE}:BoxingMentalEnv",
    "CreativeNao/BoxingModulation-v0": f"{_MODULE}:BoxingModulationEnv",
}
"""Every environment of the project and the class behind it."""
VECTOR_ENVIRONMENTS = {
    "CreativeNao/Boxing-v0": f"{_MODULE}:BoxingVectorEnv",
    "CreativeNao/BoxingMental-v0": f"{_MODULE}:BoxingMentalVectorEnv",
    "CreativeNao/BoxingModulation-v0": f"{_MODULE}:BoxingModulationVectorEnv",
}
"""The vector environment of each."""


def register_environments() -> None:
    """Register all environments; a second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    for name, entry_point in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=entry_point, vector_entry_point=VECTOR_ENVIRONMENTS[name])
