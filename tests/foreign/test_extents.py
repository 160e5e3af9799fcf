"""Small histories of which the older commits are packed: they are what the newest commit, which is not, and the edits say.

    pytest tests/foreign
    python tests/foreign/test_extents.py

Files of packed history are among the frozen ones, which test_reader.py verifies, if there are any.
"""

from __future__ import annotations

import base64
import random
import struct
import sys
import zlib
from typing import NamedTuple

import pytest
from autumnal import Autumn, Packed
from basics import Code, Damaged, Unknown, crc32c
from packed import NAMES, NUMBERS, SOLID
from trees import LEAF, VOID, Values, raw_bits


class History(NamedTuple):
    """The edits that a file begins with: a window, x first, and its value, or that it is VOID; and the file."""

    edits: list[tuple[tuple[int, ...], int | None]]
    packed: str

    @property
    def file(self) -> bytes:
        return zlib.decompress(base64.b64decode(self.packed))


# fmt: off
# Classes; numbers with VOID around, where equal subtrees are stored once; a solid; two halves, of which records are too small to be
# packed, and once all is VOID.
HISTORIES = {
    "names": History(
        [
            ((10, 20, 30, 9), 2),
            ((0, 0, 48, 16), None),
            ((32, 32, 1, 1), 5),
        ],
        (
            "eNrtnAtQVFUYgM85966LK8aiovaSC+IzxlBREVTwAeqMJaZSCCmvRVEEZrkIGr4QAR8R1pgIPjAHSdQ0HBtNKc1XNuZIoAWljqWpWMio6OiO0j33nHV3CXyQ06jzfzM7//1/zj2P///Pvfvf3eWToUly0s"
            "w4HUYIEdQCUbyjsqPQ46LBqOLipDAEAAAAAAAAAAAAAMAzCy3/3zLI4YLZYK7kIyxtBvTE88FTAAAAAAAAAAAAAPD81/+i2ZDApdHSpueUXrXgKQAAAAAAAAAAAAB4fvFPkWX1wIPr7CcA6O/8tKjqTb9M"
            "IAgRUvAmQgLGpPhVRSoHhVomJwlMTsS2sjG7cjqJpudhAUcLTKp/5xITTJgdE7NuPo9KQgRhUyskKSqhLxVB6Z0fNiWJYGlL+ZdUKG5LxyMkiFjGpecFiXRcQlYLqi5wu8Dno/qBSrpeOgCzs/VSyewWnU"
            "ti0DA9T7S1W6+bOh5JL6sTEIo7UscQ3oAIm6kjFM+wF1septCFP0KandGIFFaKbCG2C+JS8fVqLXNAdCMOaSqwSs8I6bpTgyLb8gG0zLOFjQ3UhJ1m0nRl4ebI0RXTV1ORZR5hbR4mCZ1fO5ppmEy3YxMv"
            "FGwzl0ms2i06sc1UZaLT1cCYs486VZ0Gy8gG0pyTj5JY/W2OE3dgOxaJSXbMUZuUiGmIZYvYOkwQChvbosoE8pSJ0r65l8gDP1LHNJCPn1kO7uJOUo03q7ui2JdeSJSrRwd+9bBHBaw/wpPWKo5W8pHJa+"
            "U9vd5Zr9fX6tVdrGtiFxPmqjPmXctyC0/hu3KKeVcSpp/D6ryRZM83X6sGm09k/SfzHGDnE2E+lysJC8EU86bhmyWZbwpV0pxrw0NqZ73pCKnDFqnmvKj2I9zmIa2z6kfN3ZY8d0Vmr+O5WtcwN0XW7h62"
            "HYf6RU2xllbzEcxXNUJsx1VSR7TR8W1s8UcGXtASazLcro8TcQkh+aJQQjQYbrPP9P2f0AMvpn/N7a4dF/cuuztd5rGr9X287v5LO9LDGJ4oG4yS3EuOiZa6TxgdEOAuJcrGmIREdykpLjJ+ZoLRkJhoiO"
            "rRKWZmQrxRNkRJyTHyNGlGTFyUFBkuG6bGG2Miw2Npb5B0TxZ/73/Hv8apVoD4v/jxV7/7O4jpP3L7oXXrB+1ZW2Hcrb4PVe8oCLWwI0hvez4vG1B3Ls1uD2m/3x+1E5e4ZcdlvH/2XsfZ9APGsa8jz7O+"
            "M266Dm1xqaf/K/s3lqc7GeeeWLKsbEL1l92PVo/HFwdu02bl7ievVXm7TAvM7TrUPcejbUXutYOlG6b1nbc+e/nhNuuqjKsuO3yQcnLqtX0HvnMc/oq784jtnWblzw2rv7/lwzkJYw6Pj/Vv47Kn8kqE9/"
            "rZZXRCO/wWEl1Iq8kQ7qbjP4TpL/MA1py5YaxfI9fQ95lCM+K/d8/vfkjSJMjf2mtQ6/u/v0r7D9J6zfvZ97bXVnHsnPzk8u/l3g4ht16aL2UtQ5M3OowtP9NZN2KlXepHOwI3vtv3U+/Spf0K/nL6uFbG"
            "EzNGnZyZlV65Pc3t71Nnr1btOrIoMzvY5biz78bKKx2O+R2LL/rRkLpjpFvUlXudth0oStw3VxAv/fCVw5ov15z0OXTjfGn97rge33xxriSz6taJUm0/Z1P9xF9qSrcd+Tmi3Yadd3I98lJPuDrNyS9f0c"
            "vtm1Cn09rQ9JLL7xWNKpkdTPxDfY54O1YOCS6kOXyAaHTLe7rLL1r8/ZjemgdQ9Bu16o9ulV4/NTP+F3P87dAMTb8g+jxhXL3x1vhQgqrsptZ55t3UumrTdZ5hK2YcdKxfW5O+KLJ/TVGQY36YaYBj7fGf"
            "Bpy5XnHhixuhqfrTOTEBC33mRw++8EGbz3ttHVb2ThzBI8NrCxLaF0T9iVqkZR7v6lo5puveo/bjt59K2urigX97OzF46erLy1Gpy5L7g3ZdPXj3enKfTI1/rY+haLtxn/zrSz1CzgUIf7wx+UjOrHyne2"
            "ltfUb7Fpu2XA0e/pnX6bWzFhNdhUtS/wOpd8o6XLrwftmCbg9iHv3CxLxh/NWYDWN6PrcnVd8UAyvbR9Cwj3rs+7Lu4fdl0wLtNcFEH20o3VLF40nTSikzTK5+JvO7FQAAAAAAAAAAAOCJ679Aps/m9sGm"
            "9cNyWqWtoR/sIJeAmNhYKVyKiE+R4qOlvh5SijRQijTExiayQq+PUsydZ5UdUSu7882r7IYolZ0JDcMmczkKAAAAAAAAAAAAAMDTrP/DmD6X27P0zl3ak9IELCj1fxfb+t/TS6n/e/e3fgAQNHb0CNMCcT"
            "FRnwEI9BmAuLhZzwBcBqnPAAKVngIhPAAAAAAAAAAAAADwdOt//n//Urg99bxk3Np5x0ksKvW/ZFv/96blv3X130+p9jM0JmSPkKiW/hnNKv3HeKqlfxh8/P//8Q8j2FUT"
        ),
    ),
    "numbers": History(
        [
            ((3, 5, 20, 9), -7),
            ((20, 20, 12, 12), None),
            ((7, 7, 1, 1), 30000),
        ],
        (
            "eNrtXAtUlVUWPv9/70VBeaiID7h4IUAQBBJMEFFUIiVSS2kmSgcSSgovDFyUccJHippPVKZBm5mwskwbbCw1X1mOQz6yxjRtKcLlIfJS3vH4gTP7PP5rNmvNUmdmrak537/+e/bZZ+/z2Huf1+Uutk"
            "3ONGUuNNpICCEZ6RCBed+YWegeIckS0vk2nEECAgICAgICAgICAgICAgL/syDX/yeSTAkalRHP0+fvyIwbJS0TlhIQEBAQEBAQEBAQEBAQ+Onf/7UqI42n6XdkRv3Kv1FYSkBAQEBAQEBAQEBAQEDg"
            "p4tHs0wmSgRyRj+W7LXtPFr6sMfiTowQe9dafiLQiSMklpI3EmjJuhP3Afox/Q6tKtOJZ1EpD0rPkRivEwdmxgI9hkqNRmNRAa/XFwUgohGMQqB0LCJSE9BEFIHGo3C0R6e2DhyJUZOgjGiMB7kQ+C"
            "Qa4VAeBnlCW6GBaDBtNQ7a8EZ+lCYlAdCCSvdFQ9Awi1QwesRSEgKPSndzO/RyO9wZuwZSCTGpHkwkMe7Bd/qLkGotzOtCCNOaiHYvyPZghfKZfbpwB96lIfUokGunJV1AfY/bKN1OpUiOSHWAdAs8"
            "pITQzfAwmkm1c6lO4LfwuhSgWF17kdx9vkT6RFotxUvuUje6jD5E6SgGeaGZfYYi0hV1IDBI60bquAlg2L4IU6N0Quehk7zz7SDfRp0QAW4IB0eo2hHcVcxt4ZSeCM8E7qpwSMNQKKXHUikSBCQ0xq"
            "NxQLNwCAZ+EETqk0Bbg9OGWtwW+gNXhYCGSjuAc90g54BIYI4FbbXkYeQPtC9ihveB15PSfrR18mmQkYV2kEgge6OH4NNAR+WLRiIfsFMsH9VDXMoLJDyQO+W7oxEg7UppFyrl8oN6XbiGDG3bwmuN"
            "tmtIX9zhdeX9Gg6vE1JDgARHLw+OXnBuBw8nCUq7KU3q0sFnX/S+lugPgtee6muQDsJOQizk+yEtfLJ+jUB6sKUzHZUb7S9rnfD1UE5oZ3iGgL0Z7QLyw7m2Cx2JHr2lJakzfdUSZ+CrY3eFdwDQjv"
            "AMRXbIibbnCOkANIhKDYVaneAltB1w+yHWcyI/CFpnfXKBPurBwkSb1O9s6S1YFrzwJO2hK7wjKN8NeQJ3JKUHIrm0N1+Ok4NlO7lYOimtkl6SIiVXqR4VolcgHEnFvZiZIhzCxRoCCPOg8ICmW6hT"
            "ZDC3jHr4IB2hIUwd1EunQzufMr2YrAdkjivUce3cWWyNiKQ1EReymdiAW3EjPLVU+3vItfKZ3AzcBnyL0w24Cd+mdD3I1uJqSrdhooNQK12dOkC3g8/2dkgRasGPAl0LmjehpiraRiOuh9rqqFQN8K"
            "rxDd6TOgu/Glda+NWgWQdyFVS7Aeqqg/ZJyS0oqeE9qQaJGyBD6BugXY7LKH0TpOshx7SJRjXXuA2t1fCaKkHDDA+jq0C3nNKlkJZAroRqV1C+mZeUwHOd0uW41MInPJV/HdJSXAx5sggQ+WJ4mLaZ"
            "yjGpEgvditkLU4VOVkZrqdUboN/EH6oNVX8QG6r+IPZRNW4BV/VfE2avWm+TRYrYzAx2uGkZoWpFM/RJtSKxrmp1Yl3V6hUwvjIoY9pkhGaLfcwWK1ZSb1ZbrKtavRnG0IhJ3KzTMs+28ughfrqzo3"
            "TQ3uokEmuNwFUg4lVvqrsL8WYrj2my69AzBt91yEIVS+NQxsooTb1cKK+Vo+X+8ldSrjQPJqIVnYhpMBGbYPAk3Ej1XVBlG3QVUwPchKFep3QrGJ+Y8GtuvmaYTph2mnThJpQyFzVDPbf5NGmHjrfw"
            "gKzFxAix3Kk1IB9LJ2sXVNLKt/Auus52cadqYVLLdAgttKY2rkGmci93SjkYuIw7opyGc7mlvRvQCnMpCVN1ktRQVxDaFtnASkeOLUTbGvJWsAqSkgGwMjrAYYbQWpDS8NXbHnh2sASx3UYP65wedi"
            "W2No6ANdpAS8jO5YlGUZrwVL4X7GJesLgxp1RCD+tgVGrPVeuQntfwACZ0vWUBarBYsxssTpytoW03UV90WGyu7k5k15JBRt21dDA+xpfH6fZLJukRqQMdoStxAx6KyMo1SkscqoDp4OBATeRON097"
            "2mV2LguiK7Rsf7bvNd0ceSqcagZCWTcdiHqMIYGhru6YzkQWYJiueKwtUv9FKV9XDGfU7i80lZ9+d9Xq/+H8T5eiCSx/nPPXvlx74pWOl4L56aZx0r1V9yBykqToZ3Ba9klPyDAlpRtM/qbkFwzec6"
            "ZHRfkZMkzpyWkZfoZM4/zUhWnpSRkZSYk++uSFaanppqREw+Jk0wLDy8nGRMP8VKMp2ZiZmpnBAkzgnv0/8Z/9P3VI41Th/5+//zXshkZxgPMX/DLxbKF7Y8g3iCzqEpIlsl7DqcXhbn3Dj1LV5ms2"
            "BsRLKZ2usdaQWfSV3nykIBkFfb4/6j3XjaNrF+et+dj+gOtxl6eWpJ7KqrlsKFqUphk0zLhrV1FseM6kKZesIwa/ttdF9072wGKnA+e2h8UXFE+86t+0YLN2+JlX7Lcd/SRuxZL8TX0bPQt7I/cFVB"
            "3qh9bfXpSb57nmT30TVh4Wbr1//09heTfuwO2hBfGfn/S/8hwsDjYP4H/bd4YMl4JbnqALSFn3m5nf7obGMvKf2bj98urQ1fjcbq1m12yHmkM5lTO9BuqrJp46es2prt/iDNegGTvP+R0r03oq7lVX"
            "et72xddO10ZnLjb/9vGSgHd/k6nrueS71apwVXRkduNHz59sXllYWvTkc4MvbE9+NdIcczzus9at7x3Z+vFXm77Y8eqpU1Yf50Qei3sz8dSQpvWt+z3xXJeV3qGJY3uiY0OyGis2Tj23bnBwwDb32D"
            "9Xz8986etvFr/vZzhilzq3wn++y7d52mtZ00+krZKQMWzajSuv6iZP6x9+JWLFgo3mPTr5r1rTVhuDbdrPxf+RLH+YO1B7ZdCiW0Md+ljTS/r9+3/Amqot0inl9pKRkClZW2qcA+kzDs/G5DxbVlMw"
            "IPfCJruY3ilZy2ZIj7/hlb1zw/JfT0mMy8vtfzbl5OWY7EMfXhhSGuPuv2K5NOymNsA5blzpnPb1pqI9mztexpvGzKto27naY2Wx2yXbT/9wcJ/jqmPz3CdfRG8sOng8+e2Kg0tOHs2/3t0zLDencH"
            "mXbcXY83v0B353uqYq59iFwKsJSWMK0We+RQlnMvdZZb9elLJ25/mg2XNcfKcG+HsvDBv50YmLPdnT9y+sLJ6R+8How29F7506M3ZtsO0L0+KffndyzsH8BMftLVOywr2jjYrbMrtJe173LjixeXfx"
            "BetfZKx6MaqgLKq91lS5cqfx95Ezlj+xxS0v97no4X+pSvrS+SPfZZ/u7zFFHVyXh6u/3jwx9MstjiFhrSM9Lh+zqbt6xe57L8Ptvzm98/aAnZeil0VILw62l7Xth+PJZDK+Ydfffl3dsDrrGynl61"
            "csWOqiP/fd+exdH2xoDo1xyvNfWj7p8y//fua1P64+mT6waHm/xOFZ9+F/6rMoln+T8w+dCXOvWj3PLEHhY/e8J9v8yz1ZuSUrwyRHBclk00csG3i/kSXLfZASFKmoJxYBAQEBAQEBAYH7Pf/TkxX/"
            "j385nJ9kPPih61MRRZIsycgvKjklxZBgeD41y5D6gmFMoCHLEGqYn5SSksEOes/OTn7RmJToPXqcz1ylRW6zoWc8ONmRzAOc8BBSfKbACU9BUZKiHk0FBAQEBAQEBAQEBAQEBAT+3ft/PMsv5fzE4z"
            "sq5284u1TSwP3f8+77/8Nj4P4PHz/4AuDpmdMjlXz5Gw29+Gvg4g+ZB7j4Y6y4R9CL/yxZQbOEfwQEBAQEBAQEBAQEBAQE/qP3f/5D5tc4//rpleEem6V6SQv3/8Af3f/J9f+uP//HGjPYDwCCAgE+"
            "c+H2fzFYIdd+Lf0q4OIDfBXgh5TT4+lXAfHiNwD/NfwDI0LuDw=="
        ),
    ),
    "solid": History(
        [
            ((3, 4, 5, 6, 6, 6), None),
            ((0, 0, 0, 9, 2, 2), 255),
            ((8, 8, 8, 8, 8, 8), 100),
        ],
        (
            "eNrtWw1YVFUaPvPHT6kMKqIp21Wf0pRwwEEhVhlxhkVDG4gBIYgBZgaGcGaaGYIgYVrNVSsW/GsFDamQpHK1tlb8A8k1i1I2FtbNFHVzo0ASWbCY3Lv33J+Zey+Qa+321D7nHcfhO9+5597zvee833"
            "fmgS1L8u35q013CAAAIiAGEBcaFg+C/xQiAXh3QvcBgICAgICAgICAgICAgICA8JMFPP6v0NszREyDlv7MdPdZOEdQiiKFgICAgICAgICAgICAgPDzP/+LmQYL/Wl195mTHnQNRQoBAQEBAQEBAQEB"
            "AQEB4ecLVaHdTv4go+y3fajPwNTcd6tfjNTblHZ5m6ylSlFfD8A0woHjpB+TOAAQusfBgQIAgctfjUu0jJ9owXFcnUD5SVQT/WNoPw5Iv5L2a6urcYhcDQCuLyUIG7ivJ/0Kzai2A7Y5FK7nI8dXMO"
            "M7cJz4h6ckusbH4RAKNXM9TtrqUWxto6PR4cAd9ZUAeJC/LkHNj/UGI70ZN9/u6TUYDAWGAmaqDgLwkwg3kNCTgzYxPTq+t2evUYrb5C2yMy2QwKl0dIhu1cJy+BcfdPyJl6+ve8Lw0dRxLMIARv4T"
            "svgGUspfrcVJxipdhJETw6VuQsgW4BpvuB+uBzCeGp9+HtyX7u/Q4iRjKcmu8fkEkW3SUQkk1wPApK4FSY4vpcdvxBuJ4R24wcAKOPHSKFkBZdnMAypHsXEtORy+I5kVD+IlpePLjzfftsrbxPK3qm"
            "UkYXe5410N1rl3DHwkpYomANeSBOxhCMCphxazCYB3ULkeeJgfkgu8WATDmIpZBEHbgyaIXsASejxHI8EQsSVyjWSX4QGhI6jxdd8f+sXKkQPAv54YmrxjippesLdY8TTfwEvsihf5vGIV05/SgFo9"
            "O17EzxK3gsG3ZBS7pE0uF3/e0iKDBE0m91I1XKP4XpoAnH4ogYaZINdm9hjwY++QagCms3YA4fdl+wk38GYTgAMJyw/5g04hiz/opFY4JXmJiawAfseKJjqTe27HNmY+/BVLtQlGW9E4tWdrmev5Aa"
            "XbBKMEmOYPCAVMPKj5Cuj5ZsF8JJbL25icRPdxKJicRK0IPIHOSXDykPPElFElhOyvVowsIVDvoe5X1tOafwtNH6b/vBwB9d5g6OllJ2JS9+spCWKSGuAumNuxMWYjCFnrQcHsEGo/k7/r544Xjicw"
            "8aim+sew/cQrgbWjYZ7W5DI7iNqBCdwdiWsUI9vFMB/JibzESBxcnnDNJH8nQcNsoJayc4ADSDHXDiL9cVJmAThwqPOMxt9Kw+kUhSs1I9vkdiJ0PnnHaDuE2iO+0lEkjtrPoBxwnhePc80Pc/0vdP"
            "MHU64roDDvaiqZHUbNV+O+H3lBHIcQt5/mF6Zc1/3h88UxOQjmH5iH3AQRISR03phLafytNHuYpNAR9NVw/EApdhMKdV6dQknULVc4xTcQe7kkkRxPJXZJELnn9bWjSBDFD5CIR5YgSo8BTLns8XEV"
            "awfAvKvZwyKAuF7jHo+MsApwigiXn+YXplxXjgJUyqVzOmV7sO4Pn09FP59VWPrCnR3e93it8xBJokQ1Atsaa0lWsVVXn0ttc3bZ7s0u25t4ZbqFV5bHcsvwUl5Z3aTgltHpSdyyGO9kJJMqY3F6Qu"
            "wq1JtVhYpaeVWmjFtVdvKrxAncqjA9jVvlyaTcqq6ggFuVnaf7s4ssb3aRdYJbVN3gF0ljeEWRJ7cIKl3DLVrS1dyiZIyYW4QM5FM2u6bwZtUUNzW8GiGYVxOM5dUAIm7OT0ri5vTz7dwcPdDOzbki"
            "umZgp1hvdopt4qbUpHRuiuzE3c9DrgGcm5KaeCnIArgpJxbwUkwpZbMzhjcrY6Sl8zKAjKv4Lv5pxU47z1XgVsBVXBlfYTu5ijmB9rMF0pslkGtKeYKWzhOsMVyByh/gCs4JwBOYG1zBGMMTCE/aPi"
            "a4KNXhTevDm3Y8m3ub538hUxtAYaHJ2rxp8EzE3XMltNkUOfLl1xq5Nr8f38/vx/YLpq7W23KwefbVlnk5hsJ5tnm2IHNmLjb7oajl93mOs5nzjLqgTHO+SZdhfdIjS2+yW/XjqVad0WbJy8jSryYa"
            "p8iCZBTCwucvDF0YGhYeGhwiWxgi96c7m/Mz8/S6dLvVmGHKztPbBLKJlMeqt2QYrYTLQIxFNI+lmm35VtiwICvPbNPrHsCMJptRp8eMNqwgR2/VY/YcPVZgNOmMpmzMlL86U2+FPpPZjhXprWYfah"
            "DX3UShIWF+VBsxFX0WMZQuPUufl0fcELDF8Ef7/ofkP2o4/+JrB6yI//9//smCS0nZS+j7v7p0a01/ee9nweShHyYFDwEQewjJEpQF6SiffYsPXhTWXi8Ubr12n4d2QNAaukgE9oo6nnq8uTIlZKXy"
            "QkFIlenDAcvJ3PiDR8ZuFn67KvEXHi/lbd8+UPHhzTfOKwYvZ6hNd6eX2Fbd+YT/UOmK91qXiM4FJjc989LRlrGr8aBjYz++Mat9cOyMBw/2qyITeqeJdr5T9tGe1yqLb8bEmnq6BRPPTxUr63Yfnj"
            "L0uHbF0FBn3mdyU/0nRwL6N+Pvy4+8tv6D+HiQ+q+NjRev3CXVdnisXfqm8ezOk8ff6H/sL0F9Lx3+RUt/mbhbkzzgo704ZrLZ+8DmN6ZIPc7ZinpvRKhemDG96p2Xb3oltSfFWhq7/ir7VUtTpl93"
            "6onfnquK2hcbHwALoubG9Gf9/Ut+Bt//kvxHU3Yyzb9zwfazS373evZ4L1hS3D7/p8/5PS/8qk87JYMwsgdEmy4RKvPMxDMV9zrveKG21dg3xbPr8sav3ky79O1p+ZNY4LcXG44rvq76Ik/nV9EWXl"
            "azKfTE3y0+atmW9+9IyQ/yLa/7Uji7LP7lkuKaoFMBV0KXbQreGJXesaSkL3XT6bL52KLWX89Xru9Nw149ck16eXN7xTJ9lW7BnJoHdmf4Xjl3cr1s0gOP7Y/aAL7peEL79fbqrS+2zQ3YMKPu+di1"
            "MftW1dwTduqAV3zgyeYif/8yLP/+mqBfXp2Q1bP986dSG/zXPrTtwUnXn/9TvONq/KoIwamXD2zYOaNJ5my9nlr3fvTDlQcfm43XFZV9qH7zD+MWb9hy7G+iuYu7VHP+PLP1H+mVQXsjA7D7mXVxNJ"
            "xQvnX4gec8Av/5U+M/hrL30vw39Oyp+/rBjzbvHwfrm9vnP/joF3qhfBCoNxAnltwBn9cNDYELi8YNTQc5/ZFa/POPdUDVGXjh6cjy9r3dvxfXnfly7rqYq+v7dmZP+jQwJubQw5GXFuZ5Tmvdd3Wm"
            "ZFn+W1eXFj6iOFQ4J36wa6BuzLSTPdMlrzSnNazsT1qWMri9bKr8bMS8xx+t8Dx0M2u9T1tE6riKRzwzT392NFpvfbRqV3bm8dexbX4lT24b33Coxd/y9uWcPqu2c9FFSVFr101Pc7c5yWCVdgc8d8"
            "+xaxO6Pjiyb1XK/mUd42ddODw5ZtdHh0N6Yl9ZeVoVNSvUb8V+n+PrTsXFqd8uPLt7ztKUyV8Jk+Y3b5wx23trW5P5eluFbuidtPcciQ1Z0U7LqZXyYFOZPTjYs2vcrrjrfUUz1VMki2eGxfdm4rXL"
            "o859MSHn2QSHpfiTYkXfLmPfXe8FPp3xjTL80p2FF44kgoiymVH2ysPNvwlYWtW30ZB0/N76LbuvvDiUdenp5nL7JAWNpnWliucenvfpD+CfpHw5ZZvo9t1Xetesku87KiCc35WXnVKvvd5OeEYlek"
            "JDdrsrRShwOGfHOJkCBAEBAQHhR8v/pP6rKZv5Q//wg7Vri08u2CMQCoRgVrQxLw/LwDLNhZjZgC3ACuk3eWwhzj72HCzxoWVKZ5hnu4hMBkIiGRDG90gGNueMaCIZOMFygZNJSggICAgICAgICAgI"
            "CAgICP+d87+WsjfR7YuKvdrN7+q7BCLi/B/CPf+HE2f/EPLNOv8/ojHZjNkmvW52SGjofWnOVM8OIflVgEgAoPE9vgrId05Xkl8FqImR1IgrBAQEBAQEBAQEBAQEBIQffP63cM//l8orloqvRkULxM"
            "PP/2HE2Z96j3j+D5bJiPO/1uuYlxNMBEBMnP8J43uc/63OP0aQ538t+lWA/xX+Dd4As/Q="
        ),
    ),
    "plain": History(
        [
            ((0, 0, 32, 32), 5),
            ((0, 0, 32, 32), 6),
            ((0, 0, 1, 1), 9),
            ((0, 0, 64, 64), None),
            ((3, 3, 4, 4), 7),
        ],
        (
            "eNrt3W9IE2EcB/Dnubk7EVdXYBRknJDVyEzNzCz8E6YYRBlZUUgzt+pqbmu71aCiK6IXBdEfiAgq7UVFBlEQIRHVqwrMFyUkUVQviiCIQVAvjqjn7p6p6x/OGWl8P7I99zx3eybPd4z77YaerIlq0b"
            "ZAFiWECEQkpgrvUS8ZKiclvW/XewgAAAAAAAAAjFpm+b/cp7U4EwMh3oYHjpnWu2gVVgoAAAAAAABg7Nf/YmJA5+2BgWMmx3euxkoBAAAAAAAAjF1LY5pmbRTZ/Tt8vO9iaHb+WX2tJLGOMI4Qq3Wx"
            "lrmSTTzWUWy7//Z7Et/9uzYhxhCJ0h3Wc2Xy55R4K/Lntr+pIN2j9hRxs2W/QTe1939lrSxL0mvano14h5S/YG6U2P0uPj6juujaAsf0S9TuxquGNl06xwnucEtE84UVrVBTNyuzVjfU1RUoES2shi"
            "IFSjTQGmwLhX2RiM/rzlXbQsGw5vMqu1Rtq7JdDXiV1mBAUwPRYDRiTkYRbWr5l/6c/86SI1XI///P32FulNl9lY8/8z5cNjneUGC+zwvmalL2I2YKRE5+fPUPbWLd918XH9A8saZvqjnZlBPVGz/t"
            "oK+oK/NU58sP77pvfn5Rv6+04yN9mPtlk0eae38Covi3+Zfb/cQX/aQLtevm0CWPJyUyTTH/DHZzsEcIlDaZrx5doaLeTvV2J9Z8VOZfkZz/83PZ5PaV8Vo6+QuUOAfl79SPUT3uwJqPyvwX2/1GPi"
            "7Gbh/7cPORKye9/IVB+Qu6h70DYMlHXf5WJpV2/wwfP3y0a++TbbeeUrazfsjnZVl/PC8ziEypwU4nCJvV7BSl+qoSqGAoi43EySqMXP58qQ/x8drO8tNZrvg3ypacFNapfr/SomwKxpTgZmVeiRIz"
            "71p9fn/ETnpDUyCibgn4vLPmu5sHchbSybmC5WyQSjZTJXICAAAAAAAAGJH6f2Vy/e94vzznzcRGF3WkWP+XDa7/HcOu/x2GUm7V/9WC0b8bAAAAAAAAANKr/z12/yAfv3z+au6Kjh4/zWD1f0Fy/V"
            "/Myv/iX1f/C63qXxSs6j/Dqv7FYVX/eWVW9b8SV/8BAAAAAAAARrD+53/3X+PjezqK7+bPvJFNnaz+z0+u/8tKlZh5N+gTgDUrGmrtBzrN2VIu+Rmr3vdkGIlPIgAAAAAAAABgxOt/3e7zhtTt6rk0"
            "TfbvpuLP1//N8r/019f/F7ibZVkwiEiISIksD+Pav2QcL7I+Cwg5jf7/Rgh/yXcAwFcD"
        ),
    ),
}
# fmt: on
MODELS = {"names": {NAMES}, "numbers": {NUMBERS}, "solid": {SOLID}, "plain": {None, NUMBERS}}
FILES = {name: history.file for name, history in HISTORIES.items()}


def opened(name: str) -> Autumn:
    """A history of which all has been read."""
    file = Autumn(FILES[name])
    for commit in file.commits:
        commit.layers[0].window(file.header.depth)
    return file


def picture(file: Autumn, number: int) -> tuple[Values, Values]:
    """Values and states of the cells at a commit."""
    return file.commits[number].layers[0].window(file.header.depth)


@pytest.mark.parametrize("name", HISTORIES)
def test_commits_are_what_was_edited(name: str) -> None:
    file = opened(name)
    edits = HISTORIES[name].edits
    assert file.packs and len(file.commits) == len(edits) + 1
    values, states = (a.copy() for a in picture(file, 0))
    for number, (window, value) in enumerate(edits, 1):
        axes = file.header.axes
        place = tuple(slice(a, a + n) for a, n in zip(window[:axes], window[axes:]))[::-1]
        values[place], states[place] = value or 0, VOID if value is None else LEAF
        found = picture(file, number)
        assert (raw_bits(found[0]) == raw_bits(values)).all() and (found[1] == states).all()
    assert {data[60] if data[6] else None for _, data in (file.extent(at) for at in file.unpacked)} == MODELS[name]


@pytest.mark.parametrize("name", HISTORIES)
def test_all_of_a_history_is_right(name: str) -> None:
    Autumn(FILES[name]).verify()


@pytest.mark.parametrize("name", HISTORIES)
def test_flipped_bits_are_noticed(name: str) -> None:
    file, rng = opened(name), random.Random(13)
    noticed = tried = 0
    for start in file.unpacked:
        _, data = file.extent(start)
        places = range(start, start + 32 + len(data))
        for at in rng.sample(places, 2):
            damaged = bytearray(FILES[name])
            damaged[at] ^= 1 << rng.randrange(8)
            # (Bytes of the head that readers ignore have a checksum.)
            with pytest.raises(Damaged):
                Autumn(bytes(damaged)).verify()
        if not data[6]:
            continue
        # What the checksum of the extent does not tell.
        for at in rng.sample(range(56, len(data)), 40):
            damaged = bytearray(data)
            damaged[at] ^= 1 << rng.randrange(8)
            tried += 1
            try:
                # (A number may be told in more bits than it needs, a table have values that nothing has.)
                assert Packed(file, start, bytes(damaged)).records == file.unpacked[start].records
            except Damaged:
                noticed += 1
    assert noticed > 0.9 * tried > 0


@pytest.mark.parametrize("name", HISTORIES)
def test_heads_that_cannot_be(name: str) -> None:
    file = opened(name)
    for start, whole in file.unpacked.items():
        _, data = file.extent(start)
        size, count = struct.unpack_from("<IH", data)
        packed = data[6]
        others: list[tuple[int, bytes]] = [
            *((0, struct.pack("<I", n)) for n in (0, size - 1, size + 1, (1 << 20) + 1)),
            *((4, struct.pack("<H", n)) for n in (0, count - 1, count + 1, 481)),
            # Model, or where the first record starts; first state, or the second one; the tree's depth.
            *((60 if packed else 56, bytes([n])) for n in (3, 255)),
            *((61, bytes(8)) for _ in range(packed)),
            (13, bytes([file.header.depth + 1])),
        ]
        for at, content in others:
            with pytest.raises(Damaged):
                Packed(file, start, data[:at] + content + data[at + len(content) :])
        with pytest.raises(Unknown):
            Packed(file, start, data[:6] + b"\2" + data[7:])
        for other in (data[:-1], data + bytes(4), data[:40]):
            with pytest.raises(Damaged):
                Packed(file, start, other)
        with pytest.raises(Damaged):
            whole.record(count, whole.form, file.header.depth)


def test_records_of_other_nodes() -> None:
    """A pointer leads to a record of another height, another tree's, or none."""
    file = opened("numbers")
    layer = file.commits[0].layers[0]
    root = layer.record(layer.root, Code(0, (0, 0)))
    packed = file.unpacked[layer.root // 512 * 512]
    assert layer.root == packed.first + len(packed.records) - 1 and root.pointers
    with pytest.raises(Damaged):
        layer.record(layer.root - 1, Code(0, (0, 0)))
    with pytest.raises(Damaged):
        layer.record(layer.root + 1, Code(0, (0, 0)))
    with pytest.raises(Damaged):
        packed.record(0, opened("names").commits[0].layers[0].form, 2)


def test_files_that_tell_of_no_packed_records() -> None:
    data = bytearray(FILES["plain"])
    for packs in (0, 2):
        data[66] = packs
        data[68:72] = struct.pack("<I", crc32c(bytes(data[64:68])))
        with pytest.raises(Damaged):
            Autumn(bytes(data)).verify()


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
