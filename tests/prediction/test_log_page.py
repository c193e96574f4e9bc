import base64
import json
import re

from repro.prediction.log_page import page_of


def test_a_page_has_its_figures_and_needs_no_other_file(tmp_path):
    figures = [(tmp_path / f"{number}.png", f"window {number} </script>") for number in range(3)]
    for path, caption in figures:
        path.write_bytes(caption.encode())
    page = page_of("a <b> log", figures)
    (frames,) = re.findall(r"const frames = (.*);\n", page)
    assert [(base64.b64decode(image).decode(), caption) for image, caption in json.loads(frames)] == [
        (caption, caption) for _, caption in figures
    ]
    assert page.count("</script>") == 1
    assert "<title>a &lt;b&gt; log</title>" in page
    assert 'max="2"' in page
    assert not re.findall(r"(?:src|href)=", page)
