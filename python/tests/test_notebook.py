"""`examples/notebook.ipynb` from its first cell to its last: with its own arm, and with a file as a stranger has it."""

import nbformat
import pytest
from nbclient import NotebookClient
from repository import place

NOTEBOOK = place("examples/notebook.ipynb")
SIX = "".join(
    f'<body name="l{i}" pos="0 0 {z}"><joint name="j{i}" axis="{axis}" range="-170 170"/><geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.03"/>'
    for i, (z, axis) in enumerate([(0.2, "0 0 1"), (0.1, "0 1 0"), (0.4, "0 1 0"), (0.4, "0 0 1"), (0.0, "0 1 0"), (0.0, "0 0 1")], 1)
)


@pytest.mark.parametrize("arm", ["ur5", "six.xml"])
def test_the_notebook_runs_with_its_own_arm_and_with_a_file(arm, tmp_path, monkeypatch):
    motors = "".join(f'<motor joint="j{i}" ctrlrange="-90 90"/>' for i in range(1, 7))
    (tmp_path / "six.xml").write_text(
        f'<mujoco><worldbody>{SIX}<site name="hand" pos="0 0 0.1"/>{"</body>" * 6}</worldbody><actuator>{motors}</actuator></mujoco>'
    )
    monkeypatch.setenv("ARM", arm)
    ran = NotebookClient(nbformat.read(NOTEBOOK, as_version=4), timeout=180, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in ran.cells for output in cell.get("outputs", [])]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    said = "".join(output.get("text", "") for output in outputs)
    assert len(pictures) == 2 and "blended: goal reached" in said and said.count("goal reached") == 1, said
    assert "<iframe" in outputs[-1]["data"]["text/html"]
