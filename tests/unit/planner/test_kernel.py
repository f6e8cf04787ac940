"""Where compiled kernels are cached: in the configured folder, or nowhere."""

from pathlib import Path

import pytest

from planner import kernel as kernels


def doubled(x: float) -> float:
    return 2.0 * x


@pytest.mark.parametrize("folder", ["/dev/null/kernels", "/proc/none"])
def test_kernel_without_writable_cache_is_not_cached_and_warns_once(
    folder: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The kernel is not cached beside its module: numba would load stale code after an upgrade."""
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


def test_kernel_with_writable_cache_is_cached_there_silently(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(kernels.numba_config, "CACHE_DIR", str(tmp_path / "keyed"))
    result = kernels.kernel(doubled)
    assert Path(result.stats.cache_path).is_relative_to(tmp_path / "keyed")
    assert capsys.readouterr().err == ""
