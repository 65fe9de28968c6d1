"""The studio's requests over real sockets: what they answer, and what they refuse."""

import contextlib
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from stand_in import stand_in
from viewer import Viewer, watching

from geo import get_farm, save_farm
from mission.ground.link import download
from wbf_mission.addons.web.command import _USUAL_PORT
from wbf_mission.addons.web.drafts import MAX_BODY_BYTES
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.studio import Flown, Studio, worded
from wbf_mission.addons.web.view import View
from wbf_mission.cli.app import main
from wbf_mission.planning import PlanResult
from wbf_mission.planning.sorties import UncutError
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario
from wbf_mission.scenario.scenario import all_options

START = {"planner": "spiral", "budget": "3min"}


@pytest.fixture(scope="module")
def server() -> Iterator[LiveServer]:
    studio = Studio(Scenario(farm="miniberry-30", **START))
    with LiveServer(View(), routes=studio.routes(), home="studio") as listening:
        studio.begin(listening)
        yield listening
    studio.close()


def ask(
    server: LiveServer, method: str, path: str, body: bytes | None = None, **headers: str
) -> tuple[http.client.HTTPResponse, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
    given = {"Origin": f"http://127.0.0.1:{server.port}", **headers}
    try:
        connection.request(method, path, body, given)
        response = connection.getresponse()
        return response, response.read()
    finally:
        connection.close()


def told(server: LiveServer, path: str, method: str = "POST", **draft: Any) -> Any:
    body = json.dumps({"farm": "miniberry-30", "options": START, **draft}).encode()
    response, content = ask(server, method, path, None if method == "GET" else body)
    assert response.status == 200, content
    return json.loads(content)


def test_the_page_is_at_the_beginning_and_the_live_page_beside_it(server: LiveServer) -> None:
    response, page = ask(server, "GET", "/")
    assert response.status == 200
    assert b"studio.js" in page
    assert "default-src 'none'" in response.getheader("Content-Security-Policy", "")
    assert b"live.js" in ask(server, "GET", "/live")[1]


def test_who_hangs_up_in_the_middle_leaves_no_trace(
    server: LiveServer, caplog: pytest.LogCaptureFixture
) -> None:
    head = f"POST /api/stop HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nContent-Length: 99\r\n"
    with socket.create_connection(("127.0.0.1", server.port), 30) as caller:
        caller.sendall(f"{head}Origin: http://127.0.0.1:{server.port}\r\n\r\nmore is to".encode())
        time.sleep(0.3)
    assert ask(server, "POST", "/api/stop", b"")[0].status == 200
    time.sleep(0.3)
    assert "Exception" not in caplog.text


def test_a_folder_that_is_gone_is_told_in_a_line() -> None:
    studio = Studio(Scenario(farm="miniberry-10", **START))
    with LiveServer(View(), routes=studio.routes(), home="studio") as listening:
        studio.close()
        content = b'{"type": "FeatureCollection", "features": []}'
        response, answer = ask(listening, "POST", "/api/farm?name=mine.geojson", content)
    assert response.status == 200
    assert json.loads(answer)["error"].startswith("files for drafts: ")


def test_options_are_those_of_a_scenario(server: LiveServer) -> None:
    found = told(server, "/api/options", method="GET")
    known = all_options()
    for one in found["options"]:
        option = known[one["key"]][2]
        assert (one["help"], one["low"], one["high"], one["unit"]) == (
            worded(option.help),
            option.low,
            option.high,
            option.unit,
        )
    by_key = {one["key"]: one for one in found["options"]}
    assert {"planner", "policy", "budget", "vehicle", "wind_speed_m_s", "camera_model"} <= by_key.keys()
    assert not {"farm", "mission", "terrain", "farm_crs"} & by_key.keys()
    assert "spiral" in by_key["planner"]["choices"]
    assert by_key["wind_speed_m_s"]["type"] == "number"
    assert by_key["estimate_errors"]["type"] == "flag"
    assert by_key["budget"]["type"] == "text"
    assert found["parameters"]["planner"]["lawnmower"]["direction"] == "none"
    assert found["start"] == {"farm": "miniberry-30", "options": {"budget": "3min"}}
    assert {".plan", ".waypoints", ".wpml.kmz"} <= {one["suffix"] for one in found["formats"]}
    assert "waterberry" in found["farms"]
    assert found["crops"] == ["strawberry", "tomato", "pond", "wetland"]


def test_a_plan_is_what_planning_gives(server: LiveServer) -> None:
    found = told(server, "/api/plan")
    wanted = plan(Scenario(farm="miniberry-30", **START))
    mission = found["missions"][0]
    assert mission["plan"]["path"] == wanted.path_m.round(2).ravel().tolist()
    assert mission["plan"]["duration_s"] == wanted.prediction.duration_s
    assert mission["battery_used"] == wanted.battery_used
    assert len(mission["plan"]["items"]) == len(wanted.mission.items)
    summary = found["vehicles"][0]
    assert summary["coverage"] == wanted.coverage
    assert summary["batteries"] == 1
    assert [one["code"] for one in mission["findings"]] == ["flight"]
    assert found["farm"]["name"] == "miniberry-30"


def test_the_page_is_told_why_a_mission_beyond_the_battery_is_not_cut(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def uncut(*_: object, **__: object) -> None:
        raise UncutError("no sorties: not home from all of its places")

    monkeypatch.setattr("wbf_mission.addons.web.drafts.sorties_of", uncut)
    monkeypatch.setattr(PlanResult, "is_too_long", True)
    (mission,) = told(server, "/api/plan", options={"budget": "2min", "seed": 5})["missions"]
    assert mission["warnings"] == ["no sorties: not home from all of its places"]


def test_findings_tell_where_they_are(server: LiveServer) -> None:
    mission = told(server, "/api/plan", options={"vehicle": "fixed-wing"})["missions"][0]
    turn, flight = mission["findings"]
    assert (turn["code"], turn["severity"]) == ("tight-turn", "warning")
    assert turn["told"].startswith(turn["where"])
    assert turn["fix"]
    x, y = turn["place_m"]
    assert -30.0 < x < 40.0
    assert -30.0 < y < 40.0
    assert flight["place_m"] is None


def test_several_vehicles_are_planned(server: LiveServer) -> None:
    found = told(server, "/api/plan", options={**START, "vehicles": 2})
    assert [one["name"] for one in found["missions"]] == ["vehicle 1", "vehicle 2"]
    assert [one["plan"]["system_id"] for one in found["missions"]] == [1, 2]


@pytest.mark.parametrize("suffix", [".plan", ".wpml.kmz"])
def test_exports_are_the_files_of_the_command_line(server: LiveServer, tmp_path: Path, suffix: str) -> None:
    body = json.dumps({"farm": "miniberry-30", "options": START}).encode()
    response, content = ask(server, "POST", f"/api/export?format={suffix}&mission=0", body)
    out = tmp_path / f"out{suffix}"
    assert (
        main(["plan", "--farm", "miniberry-30", "--planner", "spiral", "--budget", "3min", "--out", str(out)])
        == 0
    )
    assert content == out.read_bytes()
    assert f"miniberry-30-spiral{suffix}" in response.getheader("Content-Disposition", "")


def test_a_farm_file_is_drawn_and_planned(server: LiveServer, tmp_path: Path) -> None:
    path = tmp_path / "own.geojson"
    save_farm(get_farm("miniberry-10"), path)
    response, content = ask(server, "POST", "/api/farm?name=own.geojson", path.read_bytes())
    assert response.status == 200
    found = json.loads(content)
    assert found["document"].keys() == json.loads(path.read_bytes()).keys()
    assert found["farm"]["patches"][0]["crop"] == "strawberry"
    planned = told(server, "/api/plan", farm=found["document"])
    assert planned["farm"]["name"] == "miniberry-10"
    assert told(server, "/api/farm?name=waterberry", method="GET")["document"]["name"] == "waterberry"


@pytest.mark.parametrize(
    ("path", "draft", "wanted"),
    [
        ("/api/plan", {"farm": "/etc/passwd"}, "the studio knows"),
        ("/api/plan", {"options": 3}, "cannot be read"),
        ("/api/export?format=.exe", {}, "format '.exe' is not known"),
        ("/api/export?format=/../x.plan", {}, "is not known"),
        ("/api/export?format=.plan&mission=7", {}, "mission 7: there are 1"),
        ("/api/export?format=.plan&mission=-1", {}, "out of range"),
        ("/api/export?format=.plan&mission=x", {}, "'x' is not a number"),
        ("/api/fly?pace=0", {}, "out of range"),
        ("/api/upload?link=udpin:127.0.0.1:1", {}, "confirm that"),
        ("/api/upload?link=nonsense&confirmed=true", {}, "nonsense"),
        ("/api/upload?link=tcp:127.0.0.1:1&confirmed=true&system_id=0", {}, "out of range"),
    ],
)
def test_what_cannot_be_done_is_told_in_a_line(
    server: LiveServer, path: str, draft: dict[str, Any], wanted: str
) -> None:
    error = told(server, path, **draft)["error"]
    assert wanted in error
    assert "\n" not in error


def test_bodies_are_limited(server: LiveServer) -> None:
    response, content = ask(server, "POST", "/api/farm?name=a.geojson", bytes(MAX_BODY_BYTES + 1))
    assert response.status == 413
    assert "MiB" in json.loads(content)["error"]


@pytest.mark.parametrize(
    "path", ["/api/plan", "/api/fly", "/api/stop", "/api/upload", "/api/farm", "/api/export"]
)
def test_other_sites_cannot_ask(server: LiveServer, path: str) -> None:
    response, _ = ask(server, "POST", path, b"{}", Origin="http://elsewhere.example")
    assert response.status == 403


@pytest.mark.slow
def test_a_mission_is_uploaded_and_read_back(server: LiveServer) -> None:
    with stand_in("px4", speed=6.0) as (url, _):
        report = told(server, f"/api/upload?confirmed=true&link={url}")
        held, _ = download(url)
    assert report["verified"] is True
    assert report["accepted"] is True
    assert report["items"]["mission"] == len(held.items)
    wanted = plan(Scenario(farm="miniberry-30", **START)).mission
    assert [one.command for one in held.items] == [one.command for one in wanted.items]


def test_a_newer_draft_takes_the_place_of_older_ones(server: LiveServer) -> None:
    answers: dict[int, Any] = {}

    def plan_with(number: int) -> None:
        options = {"planner": "spiral", "budget": f"{200 + number}s", "seed": number}
        body = json.dumps({"farm": "miniberry-100", "options": options}).encode()
        answers[number] = json.loads(ask(server, "POST", "/api/plan", body)[1])

    threads = [threading.Thread(target=plan_with, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
        time.sleep(0.02)
    for thread in threads:
        thread.join(120)
    assert answers[7]["missions"]
    superseded = [one for one in answers.values() if one.get("superseded")]
    assert superseded
    assert {one["superseded"] for one in superseded} == {"another page"}


def test_what_is_given_up_is_told_as_that(server: LiveServer) -> None:
    answers: list[Any] = []
    options = {"planner": "lawnmower", "budget": "9km", "seed": 77}
    body = json.dumps({"farm": "waterberry", "options": options}).encode()
    asker = threading.Thread(
        target=lambda: answers.append(json.loads(ask(server, "POST", "/api/plan", body)[1]))
    )
    asker.start()
    while asker.is_alive():
        told(server, "/api/cancel")
        asker.join(0.05)
    assert answers[0]["superseded"] == "given up"


def test_a_flight_is_watched_and_stopped(server: LiveServer) -> None:
    told(server, "/api/fly?pace=5", options={**START, "estimator": "point"})
    viewer = Viewer()
    with watching(server) as client:
        begun_s = time.monotonic()
        while not viewer.states and time.monotonic() < begun_s + 90:
            viewer.take(client.recv(90))
        assert viewer.run is not None
        assert viewer.run["farm"]["name"] == "miniberry-30"
        assert told(server, "/api/stop") == {"stopped": True}
        while viewer.status.get("outcome") == "running" and time.monotonic() < begun_s + 90:
            viewer.take(client.recv(90))
    assert viewer.status["outcome"] == "interrupted"
    words = ended(server)["words"]
    assert re.fullmatch(r"interrupted: stopped after \d+ simulated seconds", words)


def ended(server: LiveServer) -> Any:
    """Wait for the end of the flight; return what became of it."""
    while (state := told(server, "/api/flight", method="GET"))["outcome"] in ("preparing", "flying"):
        time.sleep(0.1)
    return state


def test_a_flight_stopped_before_it_begins_is_told_as_that() -> None:
    flown = Flown(View())
    flown.stopping.set()
    flown.fly(Scenario(farm="miniberry-30", **START), None)
    assert flown.state.words == "interrupted: stopped before the start"


SURVEY = {"planner": "lawnmower", "camera_model": "dji-p1-35", "gsd_cm": 0.1}


def test_a_plan_for_a_survey_camera_is_flown_with_its_images(server: LiveServer) -> None:
    options = {**SURVEY, "estimator": "point"}
    found = told(server, "/api/plan", farm="miniberry-100", options=options)
    assert found["not_flown"] == ""
    assert "survey camera" in found["flown_note"]
    told(server, "/api/fly", farm="miniberry-100", options=options)
    assert ended(server) == {"outcome": "completed", "words": "completed"}
    viewer = Viewer()
    with watching(server) as client:
        viewer.take(client.recv(30))
    images = found["vehicles"][0]["camera"]["images"]
    assert images > 3
    assert len(viewer.readings["time_s"]) == images
    assert max(viewer.states["1"]["height_m"]) > 7.0


@pytest.mark.parametrize(
    ("options", "decider"),
    [
        ({"planner": "lawnmower", "budget": "2 batteries"}, "lawnmower"),
        ({"policy": "greedy", "budget": "2min"}, "greedy"),
    ],
)
def test_a_flight_is_headed_by_its_farm_and_planner(
    server: LiveServer, options: dict[str, Any], decider: str
) -> None:
    features = [patch([(0, 0), (3, 0), (3, 3), (0, 3)], crop="strawberry")]
    drawn = {"type": "FeatureCollection", "name": "Long field", "features": features}
    told(server, "/api/fly?pace=60", farm=drawn, options={**options, "estimator": "point"})
    while told(server, "/api/flight", method="GET")["outcome"] == "preparing":
        time.sleep(0.05)
    told(server, "/api/stop")
    ended(server)
    viewer = Viewer()
    with watching(server) as client:
        content = client.recv(30)
        viewer.take(content)
    assert viewer.run is not None
    assert (viewer.run["title"], viewer.run["planner"]) == (f"Long field, {decider}", decider)
    assert "wbf-mission-studio-" not in str(content), "a folder of the studio's own is shown"


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({**SURVEY, "planner": "", "policy": "greedy", "budget": "2min"}, "policy greedy needs leaf camera"),
        ({**SURVEY, "vehicles": 2, "gsd_cm": "", "altitude_m": 9, "budget": "2min"}, "on one vehicle only"),
    ],
)
def test_what_cannot_be_flown_is_told_with_the_plan(
    server: LiveServer, options: dict[str, Any], wanted: str
) -> None:
    found = told(server, "/api/plan", farm="miniberry-100", options=options)
    assert wanted in found["not_flown"]
    assert told(server, "/api/fly", farm="miniberry-100", options=options)["error"] == found["not_flown"]


def test_what_fails_on_the_way_is_told(server: LiveServer) -> None:
    crop = {"type": "FeatureCollection", "features": [patch([(0, 0), (4, 0), (4, 4), (0, 4)], crop="maize")]}
    told(server, "/api/fly", farm=crop, options={**START, "fields": "tylcv"})
    state = ended(server)
    assert state["outcome"] == "failed"
    assert state["words"].endswith("name fields for its crops ('Fields')")


def patch(corners: list[tuple[float, float]], **properties: Any) -> dict[str, Any]:
    """Return a field of a farm file; corners are in ten-thousandths of a degree."""
    ring = [[-82.15 + 1e-4 * x, 28.05 + 1e-4 * y] for x, y in [*corners, corners[0]]]
    given = {"name": "north", "owner": "me", **properties}
    return {"type": "Feature", "properties": given, "geometry": {"type": "Polygon", "coordinates": [ring]}}


SPIKE = [(0, 0), (9, 0), (9, 9), (8.9, 9.2), (9.1, 9.2), (9, 9.01), (0, 9)]


@pytest.mark.parametrize(
    ("farm", "remedy", "wanted"),
    [
        ([patch([(0, 9), (9, 0), (9, 9), (0, 0)], crop="tomato")], "", "corners in order?"),
        ([patch(SPIKE, crop="tomato")], "repair", "'Mend it' mends"),
        ([patch([(0, 0), (9, 0), (9, 9)], crop="tomato"), patch([(0, 0), (9, 9), (0, 9)])], "crop", "'Crop'"),
        ([patch([(0, 0), (9, 0), (9, 0)], crop="tomato")], "", "no area"),
    ],
)
def test_a_farm_is_refused_with_what_can_be_done(
    server: LiveServer, farm: list[dict[str, Any]], remedy: str, wanted: str
) -> None:
    document = {"type": "FeatureCollection", "features": farm}
    opened, mended, unnamed = (
        json.loads(ask(server, "POST", f"/api/farm?{how}", json.dumps(one).encode())[1])
        for how, one in (("name=a.geojson", document), ("crop=", {**document, "name": "Bow"}), ("", document))
    )
    drawn = told(server, "/api/plan", farm={**document, "name": "Bow"})
    for answer, called in (
        (opened, "farm file a.geojson: "),
        (drawn, "farm 'Bow': "),
        (mended, "farm 'Bow': "),
        (unnamed, "the farm: "),
    ):
        assert answer["remedy"] == remedy
        assert wanted in answer["error"]
        assert answer["error"].startswith(called)


def test_the_command_serves_until_it_is_interrupted_at_another_port_where_the_usual_one_is_taken() -> None:
    with contextlib.ExitStack() as ends:
        with contextlib.suppress(OSError):  # Another program has it
            ends.enter_context(socket.create_server(("127.0.0.1", _USUAL_PORT)))
        command = [sys.executable, "-m", "wbf_mission", "studio", "--farm", "miniberry-10", "--json"]
        process = ends.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert process.stdout is not None
        text = ""
        while not text.rstrip().endswith("}"):
            text += process.stdout.readline()
        url = json.loads(text)["url"]
        connection = http.client.HTTPConnection(url.split("/")[2], timeout=30)
        connection.request("GET", "/api/options")
        assert json.loads(connection.getresponse().read())["start"]["farm"] == "miniberry-10"
        connection.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    assert f":{_USUAL_PORT}/" not in url


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("--farm", "nowhere"), "unknown farm 'nowhere'"),
        (("--farm", "nowhere.geojson"), "no such file"),
        (("--tiles", "nowhere.mbtiles"), "nowhere.mbtiles"),
        (("--port", "70000"), "--port"),
    ],
)
def test_the_command_refuses_what_it_cannot_begin_with(
    words: tuple[str, str], wanted: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["studio", *words]) == 2
    error = capsys.readouterr().err
    assert wanted in error
    assert len(error.splitlines()) == 1
