"""Configuration strings: every listed model has a sound profile, and everything else a message that helps."""

from __future__ import annotations

from pathlib import Path

import pytest

from llm.client.profiles import ModelProfile, Price, find_profile, listed, tables
from llm.errors import ModelConfigError
from tests.source_tree import ROOT


@pytest.mark.parametrize("configuration", listed(tables()))
def test_a_listed_model_has_a_sound_profile(configuration: str) -> None:
    profile = find_profile(configuration)
    assert profile.name == configuration
    assert profile.address({}).startswith(("https://", "http://127.0.0.1:"))
    # Keys go over encrypted connections only, unless the server is on this machine.
    assert not profile.key_required or profile.address({}).startswith("https://")
    assert bool(profile.key_variable) >= profile.key_required


def test_the_models_of_the_paper_are_listed() -> None:
    paper = {"openai:gpt-5.2", "gemini:gemini-3-flash-preview", "qwen:qwen3-vl-235b-a22b-thinking"}
    assert paper <= set(listed(tables()))
    # It thinks, always: no JSON mode, and replies that take minutes.
    thinking = find_profile("qwen:qwen3-vl-235b-a22b-thinking")
    assert (thinking.mode, thinking.stream, thinking.system_role) == ("plain", True, "user")


def test_the_page_about_models_names_every_provider_and_variable() -> None:
    page = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    for provider, table in tables().items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{provider}` |"))
        assert table.get("serve") or f"`{table['base_url_variable']}`" in row
        assert not table.get("key_variable") or f"`{table['key_variable']}`" in row


def test_a_model_overrides_its_provider() -> None:
    assert find_profile("openai:gpt-5.2").max_tokens_field == "max_completion_tokens"
    assert find_profile("openai:gpt-4o").max_tokens_field == "max_tokens"


def test_a_price_that_is_not_known_is_none() -> None:
    assert find_profile("ollama:qwen3-vl").price is None
    price = find_profile("openai:gpt-5.2").price
    assert price is not None
    assert price.cost_usd(1_000_000, 0) == price.input
    assert price.cost_usd(500_000, 2_000_000) == pytest.approx(0.5 * price.input + 2 * price.output)


def test_servers_of_ones_own_decide_about_their_models() -> None:
    assert find_profile("vllm:some/model:tag").model == "some/model:tag"


@pytest.mark.parametrize(
    ("configuration", "near", "words"),
    [
        ("opnai:gpt-5.2", ("openai:gpt-5.2",), "no provider is named 'opnai'"),
        ("openai:gpt-52", ("openai:gpt-5.2",), "openai has no profile for 'gpt-52'"),
        ("gpt-5.2", ("openai:gpt-5.2",), "a model is named provider:model"),
        ("olama", ("ollama:",), "a model is named provider:model"),
        ("qwen:", (), "no model of qwen is named. Listed: qwen:qwen3-vl-plus"),
        ("openai-compatible:", (), "Name one, such as openai-compatible:my-model"),
        ("", (), "Listed: openai:, gemini:, qwen:, vllm:, llama-cpp:, local:, ollama:, openai-compatible:"),
        ("\x1b[31m\nqwen", (), "a model is named provider:model"),
    ],
)
def test_an_unknown_model_is_told_what_there_is(configuration: str, near: tuple[str, ...], words: str) -> None:
    with pytest.raises(ModelConfigError) as caught:
        find_profile(configuration)
    assert words in str(caught.value)
    assert caught.value.near[: len(near)] == near
    assert caught.value.known == listed(tables())
    assert "\n" not in str(caught.value)


def test_a_missing_key_names_its_variable() -> None:
    with pytest.raises(ModelConfigError) as caught:
        find_profile("gemini:gemini-2.5-pro").key({})
    assert str(caught.value) == (
        "gemini:gemini-2.5-pro: the environment variable GEMINI_API_KEY is not set. It holds the provider's key"
    )


def test_a_key_that_is_none_is_told_without_being_shown() -> None:
    profile = find_profile("openai:gpt-5.2")
    assert profile.key({"OPENAI_API_KEY": " sk-1234 \n"}) == "sk-1234"
    for value in ("sk-12\n34", "“sk-1234”", "sk 1234"):
        with pytest.raises(ModelConfigError, match="characters that no key has") as caught:
            profile.key({"OPENAI_API_KEY": value})
        assert "12" not in str(caught.value)


def test_a_server_without_a_key_needs_none() -> None:
    assert find_profile("ollama:x").key({"OPENAI_API_KEY": "sk-1234"}) is None
    assert find_profile("vllm:x").key({"VLLM_API_KEY": "local"}) == "local"


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("", "SCENE2DEMO_MODEL_URL, for example"),
        ("localhost:8000", "no http address"),
        ("ftp://host/v1", "no http address"),
        ("http://", "no http address"),
        ("http://host:99999/v1", "is no address"),
        ("http://[::1/v1", "is no address"),
        ("https://me:s3cret@host/v1", "holds a user name or password. Put the key into SCENE2DEMO_MODEL_KEY"),
    ],
)
def test_an_address_is_checked_before_it_is_used(address: str, words: str) -> None:
    with pytest.raises(ModelConfigError, match="openai-compatible:m: ") as caught:
        find_profile("openai-compatible:m").address({"SCENE2DEMO_MODEL_URL": address})
    assert words in str(caught.value)
    assert "s3cret" not in str(caught.value)


def test_the_environment_overrides_an_address() -> None:
    assert find_profile("vllm:x").address({"VLLM_BASE_URL": "http://gpu:1/v1"}) == "http://gpu:1/v1"
    assert find_profile("vllm:x").address({"VLLM_BASE_URL": " "}) == "http://127.0.0.1:8000/v1"


OWN = """
[openai]
timeout_s = 5
[openai.models."gpt-9"]
price = { input = 1, output = 2.5 }
[lab]
base_url = "http://lab/v1"
key_required = false
[lab.models.small]
max_images = 3
"""


def test_a_file_of_ones_own_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "models.toml"
    file.write_text(OWN)
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(file))
    ours = find_profile("openai:gpt-9")
    assert (ours.timeout_s, ours.price, ours.key_variable) == (5, Price(input=1, output=2.5), "OPENAI_API_KEY")
    assert find_profile("openai:gpt-5.2").timeout_s == 5
    assert find_profile("lab:small") == ModelProfile(
        provider="lab", model="small", base_url="http://lab/v1", key_required=False, max_images=3
    )
    assert "lab:small" in listed(tables())
    monkeypatch.delenv("SCENE2DEMO_PROFILES")
    assert find_profile("openai:gpt-5.2").timeout_s == 120
    with pytest.raises(ModelConfigError, match="no provider is named 'lab'"):
        find_profile("lab:small")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[openai", "no TOML"),
        ("openai = 3", "[openai] is a table"),
        ("[x]\nmodels = 3", "[x] is a table of settings, with a table of models"),
        ("[x.models]\ny = 1", '[x.models."y"] is a table of settings'),
        ("[x]\ntimeouts = 3", "[x] has an unknown setting 'timeouts'. Did you mean timeout_s?"),
        ("[x]\nmode = 'xml'", "[x] mode is one of json_schema, json_object, plain, not 'xml'"),
        ("[x]\nsystem_role = 'tool'", "system_role is one of system, user"),
        ("[x]\nstream = 1", "stream is true or false, not '1'"),
        ("[x]\nmax_images = true", "max_images is a number, 0 or above, not 'True'"),
        ("[x]\nmax_images = -1", "max_images is a number, 0 or above"),
        ("[x]\ntimeout_s = nan", "timeout_s is a number of seconds above 0"),
        ("[x]\nprice = { input = 1 }", "price is { input = DOLLARS, output = DOLLARS }"),
        ("[x]\nprice = { input = -1, output = 1 }", "price is { input"),
    ],
)
def test_a_faulty_file_is_told_its_place(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "models.toml"
    file.write_text(text)
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(file))
    with pytest.raises(ModelConfigError) as caught:
        tables()
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))


def test_a_missing_file_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(tmp_path / "none.toml"))
    with pytest.raises(ModelConfigError, match="cannot be read"):
        tables()
