"""Where compiled kernels are kept: under a key of their content, or nowhere."""

from pathlib import Path

import pytest

from planner import kernel as kernels


def doubled(x: float) -> float:
    return 2.0 * x


@pytest.mark.parametrize("folder", ["/dev/null/kernels", "/proc/none"])
def test_without_its_folder_a_kernel_is_kept_nowhere_and_the_user_is_warned_once(
    folder: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not beside the module either, where numba would take old ones after an upgrade."""
    monkeypatch.setattr(kernels.numba_config, "CACHE_DIR", folder)
    kernels._warn_once.cache_clear()
    makers = kernels.kernel, kernels.inner_kernel, kernels.inlined_kernel
    result = [make(doubled) for make in makers]
    assert [each.stats.cache_path for each in result] == [None] * 3
    assert result[0](1.5) == 3.0
    assert not list((Path(__file__).parent / "__pycache__").glob("test_kernel.doubled*"))
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.startswith(f"squeezetree: {folder} cannot be written, so kernels are compiled anew")
    kernels._warn_once.cache_clear()


def test_kernels_are_kept_under_the_key_of_their_content(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(kernels.numba_config, "CACHE_DIR", str(tmp_path / "keyed"))
    result = kernels.kernel(doubled)
    assert Path(result.stats.cache_path).is_relative_to(tmp_path / "keyed")
    assert capsys.readouterr().err == ""
