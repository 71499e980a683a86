"""The version stands in one place, and what repeats it agrees; workflows run what the repository has."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_papers_have_the_version_of_the_project():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert str(citation["version"]) == PROJECT["version"]
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    assert headings[0] == PROJECT["version"]


def test_no_module_has_a_version_of_its_own():
    for path in (ROOT / "jaxcomp").rglob("*.py"):
        assert not re.search(r"^__version__\s*=", path.read_text("utf-8"), re.M), path


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_what_is_there(path):
    """Extras, files and lines of the README that the commands name; each job ends some day."""
    jobs = yaml.safe_load(path.read_text("utf-8"))["jobs"]
    readme = (ROOT / "README.md").read_text("utf-8").splitlines()
    for job in jobs.values():
        assert job["timeout-minutes"] <= 60
        for command in filter(None, (step.get("run") for step in job["steps"])):
            for extras in re.findall(r'"\.\[([\w,]+)\]"', command):
                assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
            for file in re.findall(r"python (\S+\.py)", command):
                assert (ROOT / file).exists(), file
            for wanted in re.findall(r"grep -m1 '(.*?)' README.md", command):
                assert any(re.search(wanted, line) for line in readme), wanted


def test_every_python_that_is_promised_is_tested():
    checks = yaml.safe_load((ROOT / ".github/workflows/checks.yml").read_text("utf-8"))
    pythons = checks["jobs"]["tests"]["strategy"]["matrix"]["python"]
    kept = [one.rpartition(" ")[2] for one in PROJECT["classifiers"] if "Python :: 3." in one]
    assert pythons == kept
    assert PROJECT["requires-python"] == f">={kept[0]}"


def test_hooks_and_templates_can_be_read():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text("utf-8"))
    assert all(hook["language"] == "system" for repo in hooks["repos"] for hook in repo["hooks"])
    for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        template = yaml.safe_load(path.read_text("utf-8"))
        if path.stem != "config":
            assert {"name", "description", "body"} <= set(template)


def test_the_readme_is_short_and_begins_with_what_one_needs():
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 110
    places = [text.index(mark) for mark in ("<img", "```bash", "## What comes out")]
    assert places == sorted(places)
    assert text[: places[-1]].count("```bash") == 2


def test_the_recipe_for_conda_has_the_version_and_dependencies_of_the_project():
    jinja2 = pytest.importorskip("jinja2")
    folder = ROOT / ".ci" / "conda"

    def load_file_data(path: str, from_recipe_dir: bool) -> dict:
        """As conda-build reads a file."""
        assert from_recipe_dir
        return tomllib.loads((folder / path).read_text("utf-8"))

    template = jinja2.Template((folder / "meta.yaml").read_text("utf-8"))
    recipe = yaml.safe_load(template.render(load_file_data=load_file_data, PYTHON="python"))
    assert str(recipe["package"]["version"]) == PROJECT["version"]
    assert recipe["build"]["entry_points"] == ["jaxcomp = jaxcomp.__main__:main"]
    assert (folder / recipe["source"]["path"] / "pyproject.toml").exists()
    python, *run = recipe["requirements"]["run"]
    assert python == f"python {PROJECT['requires-python']}"
    of_conda = {"flatbuffers": "python-flatbuffers", "matplotlib": "matplotlib-base"}
    for dependency, written in zip(PROJECT["dependencies"], run, strict=True):
        name = re.match(r"[\w-]+", dependency)[0]
        assert written == of_conda.get(name, name) + dependency[len(name) :]
