"""What GDAL, PROJ and the schema of KML say of maps and plans: python geo.py FILE..., one JSON object.

Needs rasterio, pyogrio and pyproj (which bring GDAL and PROJ along), and pykml (the schema of the Open Geospatial Consortium).
"""

import json
import sys
from importlib.resources import files

import pyogrio
import pyproj
import rasterio
from lxml import etree


def grid(path):
    """The bands of a grid, and the middle of its first pixel in metres and in degrees by PROJ."""
    with rasterio.open(path) as opened:
        metres = opened.transform * (0.5, 0.5)
        to_degrees = pyproj.Transformer.from_crs(opened.crs, "EPSG:4326", always_xy=True)
        return {
            "bands": list(opened.descriptions),
            "first": [float(band[0, 0]) for band in opened.read()],
            "metres": list(metres),
            "degrees": list(to_degrees.transform(*metres)),
        }


def shapes(path):
    """The layers of a file, and how many shapes of which kind each has."""
    layers = {}
    for name, kind in pyogrio.list_layers(path):
        found = pyogrio.read_info(path, layer=name)
        layers[str(name)] = {"kind": str(kind), "shapes": int(found["features"]), "fields": list(map(str, found["fields"]))}
    return layers


def schema_errors(path):
    """Where a file is not what the schema of KML 2.2 says."""
    folder = files("pykml") / "schemas"
    schema = etree.parse(str(folder / "ogckml22.xsd"))
    for imported in schema.getroot().iter("{http://www.w3.org/2001/XMLSchema}import"):
        imported.set("schemaLocation", str(folder / imported.get("schemaLocation").rsplit("/", 1)[-1]))
    rules = etree.XMLSchema(schema)
    rules.validate(etree.parse(path))
    return [str(error) for error in rules.error_log]


def opened(path):
    if path.endswith(".tif"):
        return grid(path)
    found = {"layers": shapes(path)}
    if path.endswith(".kml"):
        found["schema_errors"] = schema_errors(path)
    return found


print(json.dumps({path: opened(path) for path in sys.argv[1:]}))
