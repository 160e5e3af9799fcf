"""Small trees of points: the reader finds the points that they were made of, and notices what is damaged.

    pytest tests/foreign
    python tests/foreign/test_points.py

Files that the program makes are compared with what it says in python/tests/test_foreign.py.
"""

from __future__ import annotations

import base64
import struct
import sys
import zlib
from collections import Counter
from typing import Callable, NamedTuple

import pytest
from basics import Bytes, Code, Damaged, Header, Unknown, spans
from points import Number, Point, Points, ordered, predicted, rounded, value_of
from sealing import sealed
from tokens import numbers

NONE = float("nan")


class Sample(NamedTuple):
    """Point by point what a file was made of, with coordinates in the world; how many, of how many nodes; and the file."""

    point: Callable[[int], Point]
    size: int
    nodes: int
    repeated: int
    packed: str

    @property
    def file(self) -> bytes:
        return zlib.decompress(base64.b64decode(self.packed))


# (One point of each is far from all others, so that these are in several levels.)


def in_space(i: int) -> Point:
    k = i * i * 7919 % 1009
    labelled = k % 5, (k % 5) * 40 - 100 + i % 3
    others = 3000 - 7 * i, i * 0.25 if k % 3 else NONE, 12345.5 + i // 2 * 0.125, (i * 977 % 1000) << 50
    at = i * 5 % 1200 / 4, (i * 3 + k % 7) % 300 / 4, k % 64 / 4 + 100
    return *(at if i else (-20000, 20000, 0)), *labelled, *others


def in_the_plane(i: int) -> Point:
    k = (i - (i % 10 == 9)) ** 2 * 7919 % 1009
    return (k * k % 997, k // 4 * 4 % 100, 0, -k / 8 if i % 9 else NONE) if i else (50000, -7000, 0, 1e300)


# fmt: off
# An octree of an array with a clock, labels, and attributes of several types; a quadtree of a table. Both have nodes of 25 points.
SAMPLES = {
    "space": Sample(
        in_space, 110, 8, 0,
        (
            "eNqlWgtUFEfWvt09wwwPYUQYEBFHRUREHSJRVNQewDerJAFFBR18gYKKooFEszYjiiEKJnp21WgWjTEGREdXDCYmDOhGdH2wBmOiJosbUdfdIGoSjXFP9la/5sEw7H/+Oq"
            "eo7q6qW7e+us8atk1YPi9n8TIPCgAYxgtIYbaEPRuBrR7ry1jfw5qPNUV8f4L1PtZCfnRzcANLWg3WrkCDUCgL24s6lAufqthjTG93v0nppj+HTN33haJq6OKvGAiUB4KO"
            "3XYvb2HNtixf0KQCaGGTEuZR0Ljb5F456x2/zzeEf2aif6SEwW+IkwaDXDTcub2lV6OAvndhdN5FBXBuAAojRIIndkaDWscyHNDCAzx//qS0eWpPDxP9kUixu0hmNc8RxV"
            "d92eOYsseB86pM5+cXuC6bYsOMfT5wLx9KrTpwqajYvqiadlJ+5umGnJTZ/qCJBL0nNNBQjWuwDAtUNAQakTnaIxoglLtIXeq5B1KezdClrKdn97fnbpqMl/JrQ6/TLVHJ"
            "IcztKDbkdHxLVFLI+paHzODw38Xscd83tPfqsO2XimBDtUdBJX2zwq8xg+JUaQAB0KjE6UHAwl6Kf3ALLKdgRmsP9cpd98H91IE6oEfLy/wUE1ZGNUXFYtk+0i21Eh4VlI"
            "5aFWZ5z928qDS3frqyvjKuUOkGaob1GR0Ed3a8T5UX+QZBEovUrw2m4FgDA3+7eGCFid7tKZBU/Z/PTqERcSIP0H0EW7Z7ptGjEHm0rBMICOzW820XcnY79GV1jwJDywzX"
            "IsyxG1UNrs/vaWwYF7fH3cfHp2LoLVel98+Je87VFc32j3Vd/I6UcO4BsFUJIVhyKK7YRUFph3KKi/PogcJZThnr3XsAXPtPKIwfkg83+9/07AV0beZP+355Pv/XEwEm8W"
            "j0pUKrgFp+2wzWHgVD3qYeBQ4u2/soMCS8zIbxQvxgU8LKbvUmX6LLqIOJi+tP30/M3eO+t4O9Z6xaBKrDKbpOdx1rmZ5CFXqChQYfl6UG2EhktxEa4zy7wKDj4sM3d6/7"
            "7FR9R9270Xi00bzqRRzSF+tErMuwTsE6CesErBmi3TEJ8tPT1vZIhWpkXyn8Z0S6cn8lt8p/82E6lrsGz498hV0+VtnTGS8rUonaUm6of25VXvDBBz5goucq7U1NqDyD2V"
            "pI4QYvo/oCCioxK0F4BDoQ/pDDFEQyXI10RjD2KjxJ4A1rQGMRJQN1Ec0s6wadAKxjWErZ4WLTCukr4far9Ze5/l0D4boO1IVewjIKRsdBe1pqpKVRw3paC7a6BdBPJlXc"
            "sJ5n/AwENgPRfQvt6ZyQmiCQ7aD4fWVCyk08khfxFJAOY+SoDvfGYaNnJZEnZaRwGFhvmTcIQJ4BzR2DcxAjmeY6VQ+n1PVqaOjrI+nVobekRWbJC0zQbaVci/RlCK/v5P"
            "iYZgvToyOU3lgUGINfBpGDwkrM2gqso7BOxlqH9Zws7hYbV6uxelCWnbB8/MEpn+yPT79ChfYclXHO++gDrzV77npGM+BvHadnfXprj95fnT8uch4TaKy6XnEiorWmVZnb"
            "ayIoe54cY6IlmX9DliJK0imOG7331ehhua24BQY4Cjg4FcFVeQAvSjjgRATM8f9D492Q0LEU5OqsxCSRnG7rYfOTX22F21Nbb3tPxNY7Njap1XLaWbnjLaC4tlWh5xfWsF"
            "S2v2W60pxC8W4UZcgyqzplacr1cjNV/++k8Y8GhnWbxtFZA+yXnwCMtBdjn3zdSlWf/B+9Y5NbudveueQPS/jIauVaSkGrh2ZDIECgeXphTgrM9veJjeaFb+qhlLa2cmIP"
            "kYHe/k1w8DgDz/7a+80/9wE6mCdOZH5YGzfA7ei/c8wGBpR+0ZCcZCCM8u+RA1+AzfQY2FBc/JezT5ofNscPMtFHHTQlVMYdChD3o1e9c1rxxBmEnYVTFTLqHJyImON/Xn"
            "c3xB9BfzieuEZujK36lvCUugquMZ/NU4XmW1aqiCuIzG9uZ/Hr8lSSpzCNLjxd5AUu3edEN0tRt2FiOIPy1fuIR0hnZV4l/cPP36i5A/GQ8kPMb8OP3U28Oyjvl7/oBpsL"
            "v/eUlDGhTFLGnfyxuZENhCc9YFFU0lotDBEbXl7ib3tbNY3lv61vET8l4Gt8Zc+tN/+p69TCqoloXYtwud3mKtzeosqRbRY3jmjxBvL+hxnKfx3rDrXXKXiXevWD76ru7P"
            "jH2nrVENFwJoiKnCg+x2HNxrpSVmpziFWpPW3d08Wbi1aFsUvo05ySyvouT8nYuDjU5V6V38dOP6u5nwpoPGF8n+FMGT1GZaJPh9jrsM423KLAgmYE4URXfQzRFaIr4KMt"
            "tEfIQw6Llnu1r73uhFl9a66R4maCUYsxjo7y1nJKfJ+LwmYsVAqGACWTBPUAp5QKjp4UYU8pXKY0PAsj01TgAjh0uD5aKCdhP1c8E4lwlJsNrf1Iq9FLwdB6qyd+O5OCOc"
            "ALsBYKLErgemmB46MuzB3SyGSfWEKjuXQUoXEcaejdFSb6N3d7TQuxoqPmKASnHNxEbPiswREb4o7WGmw1LEH2FoO2ZlCQDiwf/xViGIgyYxEiwY7KexSSjW5s5E8f4yKA"
            "GHxiVYqEsBckXdi9SdKFRHnZvjG5GNbPhuZCrUsVNStZU4KWj0eXCMGoKp0cloXqYQU4kNgmRnFhPPFEQ8UkbyMQ84KbFd+vYK2QhbbNxhN5y4YV9MZRV/517r2J50r3J9"
            "BzNZNH9J1Lg77l3OLCHTSKgDyONVa9vPG8vsuKTfEQ/A90ZVoUyTM0NH35ULuhCwXf9q3JnnkEIwjGXpYjrXZRY6TSQMsCbSR5KkYQZpQtVinkAWp0Dm0VNBFv3OBsjoHa"
            "5Zqqp7dMdBhtL4/pslNikoxUEnjqmmiwUHwse5QsCDVm0ug8gKUsA6AgVZlroUiqUTN9KToDl6VxNqbMJMeDZ3WlVGjtEfi0aV7hFI4ePsiei1TZSQdkxVNcOJiJ2CRTmC"
            "u1NXsYuWgtyd54iTFSMBvoiXEUN4AIPEvagoJcJeyDkAIMLLjRX1VUSWY4t9IDc6qgLEy6Wv7Td2yTillUnfouRS+w5umBk6lwQYSUfKTzEYAfR8t5i2oGaJBGmKRdIe+g"
            "Cwr3BJshxcmg8Sync+vfdOMGlNxKqRMcN5ODDlpXEt4FHvq0Um9dd6ffX5L8hYkudvB1jmcawKeA5FBTOaoctBAjHqrCnPIQz5QPXmGWCc/070FVTzOIz2sea6uRf+JbT9"
            "7nJVEQATolim6zwa8TH3CGVnMMf/I1hC23xIPASeqlUbqIA0mURlLXsLRKdMid3BgUPK1Cm0gSPvAL5agHZyMg/dtFA3N/i6kZsuVu319rvigUDyd4i6T4HL8jUj/WJ1GW"
            "08wQaGuzeAgSkUw+DBT4TJLY/BBm6dvFrsfBIcaKj4RBifvRjhb6IzZtJH07JFhVQ4Bl0Iksq5PzBz5dgxa/Wlh1Po16+nbyg9LSEaJvmCZmZelYF4jvlVh3ygaj0ektEa"
            "Qa3+JS+yQnjF+g4Eq4BvXhx/1g6RYaxj3uN4ACX1t3+NKFnluqXm3yBowD2UB4491PvvloqR6D1mcOQetAq7Pi0OFdIi5wztXpSilgpX6+8OIrmW7A8yNeDsHYKV/C25cO"
            "oO/r5nAxlCbnbekFG20QJWkgV72k8nqFB0tiaTiB5jF5l25kt6mZ9U4C2fuJNjIQuKe7QBMFW61DXK90vxz0MbysnM3RKQ6p3Air24vB/ZxBB76+2mNepan4ZoUii1/64w"
            "hIS9rVPLJbXGbcvcQCvQ31rglI/Yvnnwet2feKkqKTZGJ72sQs9BJoyrdV8yZjJRJFnf97Bf10QRV5LP62ghcHXID92841YURNjvP3XKprOylymn03NxKVRC0vLXFr/Wii"
            "0kRXOGi49UAwmqXgIsmf55AQXoxlqZ8T95xcJB8IH5NAcnATDDx4AHhlsFPvtXKcbdjVPj2rgx259W6gQF0U4tu6jzvWyIYqD879CR4M8JdALkqtlT8h5t31+ucQcGIFhK"
            "8bdrx2c4vX909OSQ77nnxDs0JOW3957S2Z1TrQ3LZUdxQqr600fVMRmpWB+N9AoYoIUSfv6tjFjOwWEsJm3k/U2Bw5r6gpXdYEnTz4kvLH7vmqKPEyd4wIJYlfYsXnOPFq"
            "wiTGQ1Y17WLVIwsGebOgXAsYzoBGw0cpnKzFUutlG2nOEBM0eP91Cj59XYGatambvaIGycNHNJdTGKcqAkkIpiZxh5p8zhKpY65sou972qtFD3n2yeZ9ZLZHKq8dTqe3v1"
            "HtKU/vyvKL03r+TuK0cwIc/cNvQpkmTguUCSg0PAGS1ztcMgjVRJd72GuElffhXwuTdMh7nfOlbe87hRuQYBn2XmvNZHqwjvDewd6HMpJDYQslKqGyUfOM5CmYfMvsbJtT"
            "SolkG51V4a6mrVcDy8q7ZOFSlPQk2VcWDvSXnnaL2LLQqpa+SZuWqMSURIrx+mAXlWt3UaJul/9I2xH4tZ6hJJLCqXHArbnFc/Vkg5AldDK6SBg1ar3jaFrdfrRUBogYuK"
            "Yt4SNlT65H14ia4t9utHNOJOHi2P+Zb/Fhs7crTqRySFQVM37648bdKoI8wXacOCQfW4IewUL8pBkszvk9uU5pSuSHEhki0kPkxvZZlG7fFnHDk/BDacqiYKIsxOYQy0HU"
            "/w5G3SrUHXIzJCQWrO8YMcb4ED9sf+Z7llwQk4DiBRDmnEJXtBt52R4hKd9E3y7ewpwo/DB4W9ZJYlJIptJdPM8ZaGsv4zokyleKcyRrsRbnjDnV60UylvyoRWxhHM4Zh3"
            "nXOMQuxGZOqniO1bifftu+e41gTbJ7kp17oCjMR4HPxnWWRwoXJKCb6LteNDFXkZ/srw+e1Ir2llQF7nvEi5jOibypxDnbhY3BA1ynKLnpMKFFbsFL8L0WeRuLGNxA3vZG"
            "WlVpmUMr6QqhLxWD/9C6ZQ6XgJKWkMfkkDjDMrAvUmZEyo1fotr1K2xfjEtYqV/SkDG2/WHvW6T+z0QzUGNzxbJ5e1fDFPlNuje7bpA/mcpY2/Ulq6LT8S0b/km0I3+iXu"
            "zmr6+Ms7okSPKcIw7IcQhWbfHaeiPMkOOA1+Vg236t3C/ZDVu8jl2Jkvud4sUuYXNc4XVnryXHAa+jtldSw7saJrvCa20Zm9MxXrrqmdEO/EXa4QV3vBIkXc4WR2S7wOvH"
            "/DBDtgu8Eq5p5X5neHlVRsn9HeGV7QqvkL2WbBd4ZXXrHK9sF/K1ekC0A3/2eLHbvRIkO5Ypjsh0gdf5on6GTBd47a7yl/ud4aX1jJL7neIFi9lMV3iF7rVkusArNE9jmO"
            "AKr+tb2MyO8bKsyxrqwJ89XroCzwTJhqfKNy8d4zVnYB9Dqgu8jL/6yv3O8KqZMUjud26/FrCpnchXqgu8AsO9DGNc4TWshE3tGK/y+9v1DvzZ42U8qEqQfJGYgUmZmFO8"
            "kvoHGRz7s23w2rTCQ+6Pc4JXTEuo3O8ULy6dHesKrzN/tIx1gZcxVGGIdIUXbWLHdowX/PRZfwf+Uu3w4j6kEiQ/LG072AVeWUPUBsf+l23wYh8/YaXXWid4FVX4GoJd4p"
            "Uoz3eKV9vvLcEu8Np64SHb1RVeWdlscMd4ceYgfwf+JLxyBbzSWuOlGMRNHCG10q/wJPaQSvnzu6zUXyI6ihtBNtv98qrcL+FlG7MYqx7I/fKVit1bsNwv4aW17S7Ps0j9"
            "fxXxyrbBi2u4yCpsfqER2uNWvJon260v//eCKF/agEcO/JnFrHyTcKPQ52w8tQy6r/E7POHW60VjHVvooDz/TT0aA1p/N+X8nIy8PPL7e8ayzJyFCCGTn/EassxkZuQi4O"
            "rM3Ly5qxYvXYhcKHMyVmYuVMsReVuH5O3L/2cc5Z6XmzF/4eBlua/xr9s6+Oe0qP5WYU+KS5xSFvbOhTRREJpEfpOmTktIOlj6q16UQM5d+p78ysqL3j+ZxX9rWCn9m8S4"
            "ZMO6dW/u7CP+1rVGUjKsM3PWveSxbHHOvOUTtv0XztVc7g=="
        ),
    ),
    "plane": Sample(
        in_the_plane, 110, 6, 11,
        (
            "eNqlV31UU0cWn/cCCYkR0CCQugbyQcoipTQYsOouLzQQqFERtOo5ZReQYGARqKXubrESPuoHugXRnkX8Cuq6aFhQdHt6zrYSsIdiTv2o0h51dUmstsVVQcuxolZ23n3vQQ"
            "ht/tnfOTN35s7cmTu/uXPzstNQkltUUCwiEEIkzw/RyPx8kKCwTMNFhMsNXAgUjHyw9Mcl0k++o77mcJ4hQxGRofj1F3mbqQwF0TusmGFEW4kHAz91bNBZ/tHDe3P3tPjz"
            "SfyE7bFqn0okRgx8WPkCtHh000rZlMK0VJKaTikIOW5dMmytOaxPmv7ALlld9d4T9HL/62/9QaDO0/xFSCEOBJoJSxzBpd4lSIs9+4EKqQhVuSJiPqXAywwNBb4+K+1yyU"
            "NxxczVKLQxhv+nvLkbCDBe5RylYYB61Bd0X0K7HNrmn+h2JzM5CWrnIxjffhrED9fAdQrmVfBhxiCM/Aj1wHO6/msr0+t+At2X2a5hA8wPh04iY/wAOttgRyeRyG5L898L"
            "hw0FrqbSw6lyreu4MMCanyHRn2uRFpHZkj3hhfyvbr+RklVOoogvA56vE5w3p8Qkfvds1XOydSC+EmV70B8My5EM/U9fy47TnhDubIo9uvVcn3FRUa7k1YaFASV3ZqGV/W"
            "tbe3s2p7rzHg2rWOjOY8GeoXE4r9R0q4PiiQzJnsArPna1vjBXEq51Nf8z0S+eONwZjOrmEyg75AWrYkrMq8xqQ/1w7n/fBVEBpFruQec74IIKhXmPQeUP9QXQUDBs7wJV"
            "AtxD4tfQCX0EbI8eZdY+wJK/JgDsdoCyHeXgdjJL8VdwLh3is2ecgqLPWdM3aXYRh8TIZInk6aULxA6nPJ1v0YTv6jrDaxYHmpyR1ZsFKdIFDqduKT8Ao05D0WNWsZ+pOV"
            "OCqHweSnonxLYm7V1zymKzqhKFe1xCCLTYS/gwQuroIx2oj0SOdP77mmT+jrzfyUXok74G9MPyHV+sqzD2f/wv93uQg3kjLmUugQlFVuukodi0SoN2RUj1DXg91CCWyXKz"
            "KGl32FVyfWsVSqpz9NUeCjoO3GU3W4GLy/eAvdHoMFj4GXQ+hXqQGep8JoMh5pYOgLXlFjMD6hImoNE4jrtd1UVoh/0I99BezNzDVObtjUAdAio7uQTXCeylrIdDxgM/9I"
            "6CyNiXXJWZknlaV1emRCaTqbQuHW5Ea10uV2UGrcFQ0D0OugzJ5x8QaBg/qzsn31z+sBKle1yBZJzPUJ2JHDA29vmkLtonbGoqPSpM1p2NTb+gfMWd9AjwZT480xfd95Jj"
            "D9RavGOkNlNCe5ETlF9InsDbmz8+k/usionmaibx1I2OIRFiHj2BjhDaLUDUhR4mWzwtX+GWDXaDFwnACp2vfx8bq3SyLhAaUiaLhm6XhlThBq0AxIM2Z1d+Sl5NraXX77"
            "fnC4mr788R9UwtS/lkf5xxXocEVeKXPZGdUNgGArSRSkYtfo3bUa/f34T108KjFEqNQonM0+bw9n+Uimwdlw8Oku5EhYFdLi6FrheVzjhSraSwhYbUG1CePiXPh0qxV9u2"
            "bEeP2+9HNF6rJfmLDn7KvOlTzBrmUTcwLEG0VDDJACIzbAUTgGWPmKhjMnYf6GYyQTUMnaXss8/Aqt+wXKbCL5AWHKV/A7SRsTanyx05J0WYvLk2p7xDFI/HcjpEKm6K/N"
            "SMmjZHlKw5GFFtvmjf96qwBYFkbZRlEo1BYzGMtlArTDP0bxDfR1laqxzHpobbkL6bh7YuJNDKs9/UDY8zWIWY99XWCV0/OmeTrOOoVG6zYNfMvr1RW1oduFxavsr363oB"
            "aqkh0amR/GKn0nfJOWfD9N0XDXh6PGuXDEvFQE0f+JWh9ILuM95QPWAM3Ce0xrm6ytTd/hvRH3tCkZXP/8y3ErUwCWCUO2Ug1BAspbqCO8bQfcJDcZimMnXF8fdQzCwpOk"
            "24B4g/SCUux0YMa+7vHhqi5kmS1pA3rsvQE6EUzf0vCvxzb8n1xpujN4bUa5m0NAC1jblMklvsGwEjr9Okv9sZRZ+N/uCgXaT16WcQUo1tzOAhm+wf0M/ypf69Yu7nlcUx"
            "HHFGts1tdIT5UkBGvIjjknIpncmMbjY92IY7Im/sDTGwYJtNdz+7L2V98GP1t/Hi2R429SynwXjiW8PLmui7GyHHbW7hiSsnBhnxlHXyQ2yTeWmOLoT9XOM+vK7wxvfxZX"
            "9BG1kyVmOZeuRXpiDcNridZ62bDYdiD8nxSXPMod44QnHjXJhMXMdqL0bekctKMO63du59B21ZcCthIye5fQs8JOHGEQfKPEAVeKw/wR/xyUnjnsjy8Ic51V14ndkxH9lJ"
            "j3lZXvxxbvyWyvLmj/HEpHFPLPXij73rpJ3bbrGH/Dl/rG/fpBZ78+di26RxT7zmxR+Lst3Oxelsdh4n/d3ik4P93mVqtjd/Sg9MGvdEhLs/fz80kZ+ZVjv3BoLGkjQDg1"
            "vsj6Gmmwry5o+1dtK4J6Z58Qdd22YniqdI2W/ixJ+Xk0E+bY9HgYRvnqm0zMwfu9tfNpiI/2ceISwtyik2xax+ez10d/7CP8n/+I+nqfQk48Ku/U2nO9k8VsT6m754iX5T"
            "67oVs0UstTxOvyzz28GbV7exeVnP7r0oeZkuincw8QKrL+duif5039t2W1RcUJRbYtj5P+zWKPQ="
        ),
    ),
}
# fmt: on


def counted(points: list[Point]) -> Counter[tuple[str, ...]]:
    """Points that can be compared: what is no number is itself."""
    return Counter(tuple(map(str, point)) for point in points)


@pytest.mark.parametrize("name", SAMPLES)
def test_points_come_out(name: str) -> None:
    sample = SAMPLES[name]
    tree = Points(sample.file)
    found = [(*tree.world(point[:3]), *point[3:]) for _, points in tree.walk() for point in points]
    made = [sample.point(i) for i in range(sample.size)]
    assert counted(found) == counted([(*map(float, point[:3]), *point[3:]) for point in made])
    assert (tree.count, len(tree.nodes), tree.repeated) == (sample.size, sample.nodes, sample.repeated)
    tree.verify()


def test_what_files_say_of_attributes() -> None:
    space, plane = (Points(SAMPLES[name].file) for name in ("space", "plane"))
    names = ["x", "y", "z", "class", "angle", "way", "gap", "gps_time", "large"]
    assert [column.name for column in space.columns] == names and "".join(column.sample for column in space.columns) == "iiiBhifdQ"
    assert [space.columns[i].name for i in space.order] == ["gps_time", "class", "x", "y", "z", "angle", "way", "gap", "large"]
    assert [column.name for column in plane.columns] == ["x", "y", "z", "depth"] and plane.clock is None
    assert (space.axes, plane.axes, space.meta["frame"]["crs"]) == (3, 2, None)


def refused(data: bytes) -> bool:
    """Whether a file is refused; no other error is raised."""
    try:
        for _ in Points(data).walk():
            pass
    except (Damaged, Unknown):
        return True
    return False


@pytest.mark.parametrize("name", SAMPLES)
def test_each_flipped_byte_is_noticed(name: str) -> None:
    # (Each byte of a file is in something that has a checksum.)
    data = SAMPLES[name].file
    for at in range(0, len(data), len(data) // 500):
        damaged = bytearray(data)
        damaged[at] ^= 1 << at % 8
        assert refused(bytes(damaged)), at


@pytest.mark.parametrize("name", SAMPLES)
def test_what_checksums_do_not_tell(name: str) -> None:
    """Bytes are wrong, one in each file, and all checksums are right: there is an error, or there are as many points as before."""
    data = SAMPLES[name].file
    assert sealed(bytearray(data), data) == data
    errors, places = 0, range(0, len(data) - 16 - 36 - 24 * 4, len(data) // 250)
    for at in places:
        damaged = bytearray(data)
        damaged[at] ^= 1 << at % 7
        try:
            tree = Points(sealed(damaged, data))
            assert sum(len(points) for _, points in tree.walk()) == SAMPLES[name].size
            tree.verify()
        except (Damaged, Unknown):
            errors += 1
    assert errors > 0.9 * len(places)


def test_other_contents_and_numbers_are_refused() -> None:
    data = SAMPLES["plane"].file
    at, size, _ = spans(data, Header.read(data))[b"PNTS"]
    for place, value, error in [(13, 5, Unknown), (13, 0, Unknown), (14, 9, Damaged), (16, 1, Damaged), (at, 2, Unknown), (at + size - 3, 10, Unknown)]:
        damaged = bytearray(data)
        damaged[place] = value
        with pytest.raises(error):
            Points(sealed(damaged, data))


def test_ordered_numbers() -> None:
    values: list[tuple[str, list[Number]]] = [
        ("Q", [0, 1, 1 << 63, (1 << 64) - 1]),
        ("q", [-1 << 63, -1, 0, (1 << 63) - 1]),
        ("B", [0, 255]),
        ("f", [-float("inf"), -1.5, -0.0, 0.0, 2.0**-149, 1.5]),
        ("d", [-1e300, -0.1, -0.0, 0.0, 5e-324, float("inf")]),
    ]
    for sample, row in values:
        keys = [ordered(value, sample) for value in row]
        assert keys == sorted(set(keys)) and list(map(str, row)) == [str(value_of(key, sample)) for key in keys]
    for sample, number in [("B", 256), ("b", 128), ("I", -1), ("f", 1 << 31)]:
        with pytest.raises(Damaged):
            value_of(number, sample)


def test_predictions() -> None:
    steady = [5, 0, 0, 0, 0, 0]
    assert predicted(steady, 0, None) == steady and predicted(steady, 1, None) == [5] * 6
    # Along a line there are no errors behind the first two points.
    assert predicted([10, 3, 0, 0, 0, 0], 2, None) == [10, 13, 16, 19, 22, 25]
    assert predicted([10, 3, 0, 0, 0, 0], 2, [0, 1, 2, 4, 5, 8]) == [10, 13, 16, 22, 25, 34]
    assert predicted([8, 8, 0], 3, None) == [8, 16, 12]
    assert [rounded(f) for f in (0.5, -0.5, 2.4, NONE, 1e30, -1e30)] == [1, 0, 2, 0, (1 << 63) - 1, -(1 << 63) - 1]


def test_numbers_by_tokens() -> None:
    # One context with one token, 3, which takes no bits: -2 three times.
    table = 0 | 3 << 1 | 3 << 11 | 13 << 21
    data = struct.pack("<HII", 5, 0, 0) + table.to_bytes(5, "little") + struct.pack("<2I", 1 << 16, 1 << 16)
    assert numbers(Bytes(data), [0, 0, 0]) == [-2] * 3
    for damaged in (data[:-1], data[:2] + b"\1" + data[3:], data[:-1] + b"\1", data[:14] + b"\xff" + data[15:]):
        with pytest.raises(Damaged):
            numbers(Bytes(damaged), [0, 0, 0])
    with pytest.raises(Damaged):
        numbers(Bytes(data), [0, 1, 0])


def test_codes_of_points() -> None:
    tree = Points(SAMPLES["plane"].file)
    corner = tree.corner
    assert tree.code(corner) == Code(tree.deepest, (0, 0)).code
    with pytest.raises(Damaged):
        tree.code((corner[0] - 1, corner[1], 0))


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
