"""Small histories with packed older commits, checked against the newest commit, which is not
packed, and the edits.

    pytest tests/foreign
    python tests/foreign/test_extents.py

The frozen files, which test_reader.py verifies, may include files of packed history.
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
from basics import Code, CorruptFile, Unknown, crc32c
from coder import NAMES, NUMBERS, SOLID
from trees import LEAF, VOID, Values, raw_bits


class History(NamedTuple):
    """The edits that a file begins with: a window, x first, and its value, or None for VOID; and
    the file."""

    edits: list[tuple[tuple[int, ...], int | None]]
    packed: str

    @property
    def file(self) -> bytes:
        return zlib.decompress(base64.b64decode(self.packed))


# fmt: off
# Classes; numbers with a VOID margin, where equal subtrees are stored once; a solid; two halves,
# whose records are too small to be packed, with one commit all VOID.
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
            "eNrtXAlQlEcW7v+fGSIolyIeHA4EEAVBBaOIKAIhSojHBrIVkrigYMQgEBiUNSGeKNGoqKzBuLuRqDk0YhYTTdRcrks0Hlmj0ZQit8ihcsvxw/S+Pv7RZKu21EptbbL9/fVPv379Xh/vvb6mBrZOzTBkLEq2kBBC"
            "MtIhgvIDY2eh+4QkS0jn1XgKCQgICAgICAgICAgICAgI/M+CXP+fSjDEaVRGLE/n3pUZP1JaJiwlICAgICAgICAgICAgIPDrv/9rVUYqT9Puyoz8g0+TsJSAgICAgICAgICAgICAwK8Xj2caDJQYzRl9WbLPsuto"
            "2Ri3JV0YIfbmmH4i0IWDJZaSNwxoybwLPwL0E05vaVWZLjyLSrlROkpivC48OiMa6LFUahQah3byer2QLyIa/mgClI5DRGoSmoyC0UQUhPbq1NaBIzFqCpQRjYkgNwE+iUYQlAdCntBmqD8aSFuNgTY8kTelSYkv"
            "tKDSfdAgNMQk5Y8eM5VMgEele7gdjNwOd8eugVRCTKoXE0mMe/Hd/iKkWgvzuhDCtCaibQTZXqxQPrNPN+7EezSkHgVyHbSkG6g7uJ3SHVSK5IhUJ0i3wkNKCN0CD6OZVAeX6gJ+K69LAYrVtQ/JPWdLpU+lNVKs"
            "5Cr1oEvoI5SGIpEHmvnIYES6og4EBmneRB03CQzbB2FqlC7oPHSSd74D5NupE4LBDUHgCFU7mLuKuS2I0pPhmcRdFQRpIAqg9DgqRYKAhMZENB5oFg7+wPeDSJ0NtDk4bbDJbQH3uGoCaKi0DTjXBXI2iATmONBW"
            "S8YgH6C9EDP8CHjdKe1NWyefehmZaBuJBLInehQ+9XRUXmg4GgF2iuajepRLeYCEG3KlfFc0DKSdKe1IpRzvqdeRa8jQtiW85mi7hvTFFV5n3q+h8NojNQRIcBh5cBjBuZ08nCQo7aE0qUsHn33QB1qiPwBea6qv"
            "QToIOwmxkO+LtPDJ+jUMOYEtHeioXGh/WeuE7wTlhHaAZxDYm9GOID+UazvSkTihd7QkdaCvWuIAfHXszvDaAm0Hz2Bkhexpe3aQ2qIBVGow1GoPL6GtgNsXsZ4T+QHQOuuTI/TRCSxMtEn9DqbegmXBC7NpD53h"
            "HUb5LsgduMMp3R/JZcZ8OUb2l63kEum4tFpaKIVJztJNVIhehXAkFRsxM0UQhIs5BBDmQeEGTbdSp8hgbhn18kHaQUOYOshIp0MHnzJGTNYDMscV6rgO7iy2RoTRmogL2UxsxG24CZ56qn0Hcm18JrcAtxHf4nQj"
            "bsa3KX0TZOtxLaXbMdFBqI2uTp2g28lnewekCLXix4GuB80bUFMNbaMJ34TaGqhUHfBq8XXekwYTvxZXm/i1oNkAclVUuxHqaoD2ScktKKnjPakFiesgQ+jroF2JKyh9A6RvQo5pE41arnEbWqvjNVWDRjk8jK4B"
            "3UpKl0FaCrlSql1F+eW8pBSea5SuxGUmPuGp/GuQluESyJNFgMiXwMO0y6kckyo10W2YvTBV6GRltJZavRH6Tfyh2lD1B7Gh6g9iH1XjFnBV/zVj9qr1NpukiM3KwQ43TCNUrVgOfVKtSKyrWp1YV7V6FYyvAsqY"
            "Nhlhuck+5SYrVlNv1pqsq1q9BcbQhEncrNMyz7bx6CF+urujdNLe6iQSa03AVSDiVW+quwvxZhuPabLr0DMG33XIQhVN41DGykjNTblQzpEj5H7yOSlXmgMT0YxOxFSYiM0weBJupPpuqLIduoqpAW7AUK9Rug2M"
            "T0z4HTdfC0wnTDtNunADSpmLWqCe23yadEDHW3lA1mNihGju1DqQj6aTtRsqaeNbeDddZ7u5U7UwqWU6hFZaUzvXIFPZyJ1SCQau4I6opOFcaWrvOrTCXErCVJ0kddQVhLZEFrDSkWML0TaHvBmsgqTEFlZGGzjM"
            "EFoLUhq+elsDzwqWILbbOME65wS7Elsbh8EaraclZOdyRyMpTXgq3wN2MQ9Y3JhTqqGHDTAqteeqdUjP63gAE/qmaQFqNFmzByxOnK2hbTdTX3SabK7uTmTXkkFG3bV0MD7Gl8friiSD9JjUiY7QlbgRD0Zk5Rqp"
            "JQ5VwHRwcKAmcqWbpzXtMjuX+dEVWrb+ts9VXZQcCqea/lDWQweiHmNIYKirO6YzkQUYpisea4vUf0HK15XAGbXnG031Fz9eMft/OP/TpWgSy3/K+Wl2Y6btN5ZU8NNN05T7q+5h5CRJwZjTsltaXLohIU1v8DEk"
            "ztd7Rk0PD/fWpxvSElPTvfXxCfOT4gwJI5wSF6WmpBkS4vVLEg0L9C8lJsfr56UkGxKTM1Iy0llsCTyY/yf/u/+32IZvE/7/7ftfw25oFIc5P+7lV3eHWoyY+z0ii7qEZIms13Bqsfmpvv5nqWr4tRt8Y7WZKKnL"
            "OdocsovPOZUf2ZmI/L4uCn/PecOo+iV5az+2/sT5c8ffLU05kVl3SV+8OFUzYEjynj3F0UHZU0IumgcPfH2fo253Vv8S+09Obw+M3Vky+YpP84JN2qGnXrXeevTTmBVL8zf2aXIvNIYd8K053Betv704N8997V/7"
            "xK36TDj2Qf0fwvJu3IGvBD6xMGn9vDefh8XB4iH8b7l70FBttYT8W58KJbyKnrczfngf2kvPf3bD9ktrAtbg0+9rNXuetqk7nF0906O/U83kE0ev2jf0XZLu7Dej4LT3sQqtu+Jac7l3lxe+erI+ImNJ+StPlvq+"
            "+8cMXe9Fry1mhasjwrKaDs493rKqsKx49vMDz29PXBlWHvl5zFdtW947suXjcxu/eWvliRNmH2eHHYt5O/7EoOb1bUXu+AXHVZ4B8eN6I6InZDZVbQg9vW6gv+9W1+j9tfMyFn73/ZIPvPVHrFJeqPKZ5/hDnvZq"
            "5vQvU1dLKDlw2vXLK3VTp/ULuhy8YsGG8r06+e9awxYLvWXqb8L/YSx/jDswYo3xwsDtc6LM6SX9wf1vu7Zms7ZHRieU20uHQ740pyw5CtJnbZ6LzH6uom6nbe75jVaRxpDMZTOkJ3d4ZBW8sfzlkPiYvNx+3yYd"
            "vxSZdfij84PKIl19ViyXhtzQ+jrEjC+L6lhvKN67qfMlvHHsnKr2gjVuq0pcLlp+8edDB+xWH5vjOvUC2rH40OeJu6oOLT1+NP9aT++Q3OzC5d2WVePO7nX65E8n62qyj50ffSUuYWwh+sqrOO5UxgGzrG3FSTkF"
            "Z/2ejnL0CvX18VwUOPzglxd6s6YXLaoumZH74ajP3onYFzozOsffcv602GfenZp9KD/ObntrSGaQZ0Sy4rLMasrebZ47v9z0fsl589+nr34xfGdFeEe9oXpVQfKbYTOWP7XZJS/3+Yihf6tJOONw0GvZF0W9hvBD"
            "6/Jw7XebJgec2Ww3IbBtuNulYxYNVy5b3fHQ3/6H/e5dtgUXI5YFSy8OtJa1HZ/FkvmUvMOqn/W6hiEN5teTKtevWPCao9PpH89m7fnwjZaASPs8n9cqp3x95p+nXv/LmuNp/YuX940fmnm//qc+C2f5Her+v7ik"
            "8NKWYZWSBKUh97MpW/zHTVm5JStDJDsFyWTDRyw7+kGjSpYfQYpfmKKeVgQEBAQEBAQEBB7m/E9PV/w//r3C+fu1+10KioK+Jv/fD7mGJyYl6eP0c1My9Snz9WNH6zP1Afp5CUlJ6eywN2q80iq3W9DTHSiQzEOc"
            "7RBSRoTA2U5B4ZKiHkgFBAQEBAQEBAQEBAQEBAR+uft/LMu/xvnD2mdePTjvUI6kgVL3n97/x4yF+z983PMFwDMzp4cp+fL3GvoVAOiQzEN8BYCx4hpMvwKYJStolvCPgICAgICAgICAgICAgMAvev/nv2LO4vxz"
            "VR3LDrYcDZfIHye6/ez+T67/997+/UYD4MZ/wV8hV30tvf5feIjrvzdSTk6k1/9Y8QuA/wr+BUZ65Es="
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
            "eNrt3VtIU3EcB/D//2w7R0ptPWQWGX8jo8hqmZmZeSkvSGQ3u9CLszZpON3cjjV66eRjVFhBTxkm0oPRQ1EvWVD0oIE9JIIS3SisMIpBUA+HoP+5qSuKeak0vh/Z/uf/P5fJ/7eN890ZeqG4SW6qb5hFCSECEYkm"
            "z3PWQ+LloKR/6KCbAAAAAAAAAMC0pcX/7V65xmENBM02NLrN4v5NuzFTAAAAAAAAADM//4vWgGK2zaPbpEaPVmGmAAAAAAAAAGau0ogs6wsuo3/PHB+8GlyZ0arslyTeEZIJ0dsk3nKdicStb8WXR26/Jpmrf9Va"
            "IhyRKG3UHyvBfEzJbEXzsY1vKkj3qXGIqNby36CXGuu/8dbplKRXtC0R5Y2r/oK2kGX0b5njhddp5fwzw5+p0Y0Wxne4yWwnLA3VhGVviMmrZV8tW15VUVaWycJyyBcMZzKPt9ZfI3tXpPnqg4GQ7PWwYz75CKvz"
            "NXjY4UCD7GtoCjSFteNQVHUC9c/+uf777pbWof7/f/1t2kKO0a8zx+We5Pdvbp7apr3PC9qUUv4jJgjEGbt/0Q+tNfknb4jd9kySLhYPLuLdgQXni6o/N9KXNCnh4rXnH9723v7yrPxE9pVPtCft6yG3tObBXBTj"
            "X9Y/1+hbX/ST2ksOrKJbHqdYNR1n/e38ZuN7CJTu1Z49CqOi0kaVNgfmfFrWPy+2/k8vJ5KuzjnyZOovUOIYU3+H0kKVqA1zPi3rn2/0d5njYqSr5cPtR0nzJld/YUz9BcXN3wEw5dOu/npNCoz+RXNc6auq3v7k"
            "0h1K+dot8ZyYzfrtiZlKnJSq/FSC8ANqHdd4n1ECFVSWr1onqjC19Ten+7g5vqN7cyvrGKik/EVMlpT5/H5Www4FIixQy9ZlsYh2d9jr94eNaq8fra8wmfrm8fqqpIAfqQC1AQAAAAAAAJjy/L8zNv/3RFynXa+/"
            "PaS2uPJ/zmj+t004/9tUlqvn/yJBHVkNAAAAAAAAAFOX/91GP2KOL3vQ1zx7qDyV2vlaFpv/1/L4v3Zs+t/IA78o6Onfrqd/cULpPz1HT/87cfUfAAAAAAAA4A/lf/Pv/stW/lfaX4T2LGTUwddmxOb/nGwW0e7G"
            "fAKwb0dFibGjtj0Zd/zn9OzvtqvWJxEAAAAAAAAAMOX5X4nN/+86ouGPW4dTqPjz9X8t/sek/w1Op6ASkRC+sdM5gWv/knrOpef/oEMd+Q+E8Bd8ByDnRDU="
        ),
    ),
}
# fmt: on
MODELS = {"names": {NAMES}, "numbers": {NUMBERS}, "solid": {SOLID}, "plain": {None, NUMBERS}}
FILES = {name: history.file for name, history in HISTORIES.items()}


def opened(name: str) -> Autumn:
    """Returns a history after reading all of it."""
    file = Autumn(FILES[name])
    for commit in file.commits:
        commit.layers[0].window(file.header.depth)
    return file


def decoded(file: Autumn, number: int) -> tuple[Values, Values]:
    """Returns values and states of the cells at a commit."""
    return file.commits[number].layers[0].window(file.header.depth)


@pytest.mark.parametrize("name", HISTORIES)
def test_commits_are_what_was_edited(name: str) -> None:
    file = opened(name)
    edits = HISTORIES[name].edits
    assert file.packs and len(file.commits) == len(edits) + 1
    values, states = (a.copy() for a in decoded(file, 0))
    for number, (window, value) in enumerate(edits, 1):
        axes = file.header.axes
        place = tuple(slice(a, a + n) for a, n in zip(window[:axes], window[axes:]))[::-1]
        values[place], states[place] = value or 0, VOID if value is None else LEAF
        found = decoded(file, number)
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
        offsets = range(start, start + 32 + len(data))
        for at in rng.sample(offsets, 2):
            changed = bytearray(FILES[name])
            changed[at] ^= 1 << rng.randrange(8)
            # A checksum covers the head's bytes that readers ignore.
            with pytest.raises(CorruptFile):
                Autumn(bytes(changed)).verify()
        if not data[6]:
            continue
        # Corruption that the checksum of the extent does not show.
        for at in rng.sample(range(56, len(data)), 40):
            changed = bytearray(data)
            changed[at] ^= 1 << rng.randrange(8)
            tried += 1
            try:
                # A number may be coded in more bits than necessary, and a table may have unused
                # values.
                assert Packed(file, start, bytes(changed)).records == file.unpacked[start].records
            except CorruptFile:
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
            # Model, or offset of the first record; first state, or the second one; the tree's
            # depth.
            *((60 if packed else 56, bytes([n])) for n in (1 if packed else 3, 255)),
            *((61, bytes(8)) for _ in range(packed)),
            (13, bytes([file.header.depth + 1])),
        ]
        for at, content in others:
            with pytest.raises(CorruptFile):
                Packed(file, start, data[:at] + content + data[at + len(content) :])
        with pytest.raises(Unknown):
            Packed(file, start, data[:6] + b"\2" + data[7:])
        for other in (data[:-1], data + bytes(4), data[:40]):
            with pytest.raises(CorruptFile):
                Packed(file, start, other)
        with pytest.raises(CorruptFile):
            whole.record(count, whole.form, file.header.depth)


def test_records_of_other_nodes() -> None:
    """A pointer leads to a record of another height, another tree's, or none."""
    file = opened("numbers")
    layer = file.commits[0].layers[0]
    root = layer.record(layer.root, Code(0, (0, 0)))
    packed = file.unpacked[layer.root // 512 * 512]
    assert layer.root == packed.first + len(packed.records) - 1 and root.pointers
    with pytest.raises(CorruptFile):
        layer.record(layer.root - 1, Code(0, (0, 0)))
    with pytest.raises(CorruptFile):
        layer.record(layer.root + 1, Code(0, (0, 0)))
    with pytest.raises(CorruptFile):
        packed.record(0, opened("names").commits[0].layers[0].form, 2)


def test_files_without_the_flag_of_packed_records() -> None:
    data = bytearray(FILES["plain"])
    for packs in (0, 2):
        data[66] = packs
        data[68:72] = struct.pack("<I", crc32c(bytes(data[64:68])))
        with pytest.raises(CorruptFile):
            Autumn(bytes(data)).verify()


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
