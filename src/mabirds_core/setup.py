from setuptools import Extension, setup

FOLDER = "mabirds_core/kernels"
KERNELS = Extension(
    "mabirds_core.kernels.library",
    sources=[
        f"{FOLDER}/{name}.c"
        for name in ("module", "arrays", "factored_backward", "factored_forward", "factored_likelihood", "coupling")
    ],
    depends=[f"{FOLDER}/{name}.h" for name in ("kernels", "fixed", "fixed32", "factored")],
    # The same bits everywhere: no fused multiplications, nothing that only this machine's processor can do.
    extra_compile_args=["-std=gnu11", "-O3", "-ffp-contract=off", "-fno-trapping-math", "-fvisibility=hidden"],
    optional=True,  # where there is no compiler, numpy does
)

setup(python_requires=">=3.11", ext_modules=[KERNELS])  # colcon cannot read python_requires out of pyproject.toml
