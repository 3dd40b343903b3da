"""What pyproject.toml cannot say: the wheel carries problems/, which stands beside the package, as ssm_planner/problems."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithProblems(build_py):
    """Copies the shipped problem, robot, drive and motor files; an editable install finds them in the checkout."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "ssm_planner" / "problems"
            shutil.copytree("problems", target, dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithProblems})
