"""Which packages there are, found rather than listed: app/, shaders/ and scenes/ install inside irrsplat."""

from setuptools import find_packages, setup

INSIDE = ("app", "shaders", "scenes")  # folders beside irrsplat/ that install as irrsplat.app, irrsplat.shaders, irrsplat.scenes

setup(
    packages=[
        *find_packages(include=["irrsplat", "irrsplat.*"]),
        *(f"irrsplat.{name}" for folder in INSIDE for name in find_packages(include=[folder, f"{folder}.*"])),
    ],
    package_dir={"irrsplat": "irrsplat", **{f"irrsplat.{folder}": folder for folder in INSIDE}},
    package_data={
        "irrsplat": ["py.typed"],
        "irrsplat.shaders": ["**/*"],
        "irrsplat.scenes": ["**/*"],
    },
)
