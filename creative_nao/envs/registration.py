"""Make the environments known to Gymnasium, by strings, so that nothing heavy is loaded."""

from __future__ import annotations

ENVIRONMENTS = {
    "CreativeNao/Boxing-v0": "creative_nao.envs.boxing_envs:BoxingEnv",
    "CreativeNao/BoxingMental-v0": "creative_nao.envs.boxing_envs:BoxingMentalEnv",
    "CreativeNao/BoxingModulation-v0": "creative_nao.envs.modulation:BoxingModulationEnv",
}
"""Every environment of the project and the class behind it."""
VECTOR_ENVIRONMENTS = {
    "CreativeNao/Boxing-v0": "creative_nao.envs.vector_env:BoxingVectorEnv",
    "CreativeNao/BoxingMental-v0": "creative_nao.envs.vector_env:BoxingMentalVectorEnv",
    "CreativeNao/BoxingModulation-v0": "creative_nao.envs.modulation:BoxingModulationVectorEnv",
}
"""The class that makes many copies of each at once."""


def register_environments() -> None:
    """Register all environments; a second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    for name, entry_point in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=entry_point, vector_entry_point=VECTOR_ENVIRONMENTS[name])
