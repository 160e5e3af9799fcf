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
from coder import NAMES, NUMBERS, SOLID
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
            "eNrtXAtUlVUWPv9/7yVAeaiIAvfihQBREEwwRURRiZJIbZJmReVAQkkhMHBRsvCNkqaSMQ3mzASVaVrYaGH5Kh2HMtPykbYUeYO8lHc8fuDMPo//as1as9TVmjU15/vXf88+++x9Hnvv87rrwusz0k3pi5OsJYSQ"
            "jHSIoHzvhHnoNiHJEtL5NJ9EAgICAgICAgICAgICAgIC/7Mg1/9H4k2xGpURw9NnbspMGiutEJYSEBAQEBAQEBAQEBAQEPj13/+1KiOFp6k3Zcb+wa9FWEpAQEBAQEBAQEBAQEBA4NeLBzJMJkqM54xBLNlj03Oo"
            "7D6PpT0YIfZmm38i0INDJZaSNwxoyaoH3wP0g4Y3tapMD55HpTwoPV9ivB48Pj0K6AlUahyaiPJ5vT7IHxGNQDQZSiciIjUVTUOhaAoKQbt1auvAkRg1HcqIxhSQmwyfRCMEyoMhT2gLNBQNp61GQxveyJfSpMQf"
            "WlBpSzQCOZmlAtH95pLJ8Kh0H7fDALfDzbFrIJUQk+rHRBLjfnyzvwip1sK8LoQwrYloD4BsP1Yon9mnF3fjHRpSjwK5LlrSC9SPuJPSXVSK5IhUN0i3w0NKCN0GD6OZVBeX6gF+O69LAYrVtQfJfadLpU+ldVKM"
            "5C71oYvoI5SKIpEXmnvPSES6og4EBmnVQh03FQxriTA1Sg90HjrJO98F8p3UCaHghhBwhKodyl3F3BZC6WnwTOWuCoE0GAVReiKVIkFAQmMKmgQ0C4dA4AdApD4KtBU4baTZbUG3uGoyaKi0PTjXDXL2iATmRNBW"
            "S+5DfkD7IGb4MfB6UtqXtk4+jTIy0/YSCWRvdC98GumofNBoNAbsFMVHdS+X8gIJD+RO+e5oFEi7UlpPpfS31KvnGjK0bQOvFdqmIX1xh9eV98sZXkekhgAJjgEeHAPg3G4eThKU9lGa1KWDT0v0vpboD4PXjupr"
            "kA7CTkIs5AchLXyyfo1CBrClCx2VG+0va53wDVBOaBd4RoC9Ga0HeWeuracjMaC3tSR1oa9a4gJ8deyu8A4B2gGekcgWOdL2HCAdgoZRqZFQqyO8hLYF7iDEek7kh0HrrE966KMBLEy0Sf0u5t6CZcELj9IeusI7"
            "ivLdkCdwR1N6KJLLBvLkaDlQtpVLpOPSWul5KUxylZpQIXoZwpFUPICZKUIgXKwggDAPCg9oup06RQZzy6ifD9IBGsLUQQN0OnTxKTOAyXpA5rhCHdfFncXWiDBaE3Ehm4nNuAO3wNNAtX+EXAefyW3AbcbXOd2M"
            "W/ENSjeBbAOuo3QnJjoIddDVqRt0u/ls74IUoXb8ANANoHkNaqqlbbTgJqitkUrVA68O1/CeNJr5dbjazK8DzUaQq6LazVBXI7RPSq5DST3vSR1I1IAMoWtAuxJXUPoaSDdBjmkTjTqucQNaq+c1VYNGOTyMrgXd"
            "SkqXQVoKuVKqXUX55bykFJ6rlK7EZWY+4an8q5CW4RLIk0WAyJfAw7TLqRyTKjXTHZi9MFXoZGW0llq9GfpN/KHaUPUHsaHqD2IfVeM6cFX/tWL2qvW2mqWIzcrBDtfMI1StWA59Uq1IrKtanVhXtXoVjK8Cypg2"
            "GWG52T7lZitWU2/Wma2rWr0NxtCCSdxs0DLPdvDoIX66uaN0097qJBJrLcBVIOJVb6q7C/FmB49psuvQMwbfdchCFUXjUMbKWE2TXChnyxHyYPmMlCMtgIloQSdiCkzEVhg8CTdSfS9U2QldxdQA12CoVyndAcYn"
            "JvyWm68NphOmnSZduAalzEVtUM8NPk26oOPtPCAbMDFCFHdqPchH0cnaC5V08C28l66zvdypWpjUMh1CO62pk2uQqTzAnVIJBq7gjqik4Vxpbq8GWmEuJWGqTpJ66gpC2yBrWOnIsYVoW0HeAlZBUjIEVkZ7OMwQ"
            "WgtSGr562wHPFpYgttsYYJ0zwK7E1sZRsEYbaQnZuTzRWEoTnsr3gl3MCxY35pRq6GEjjErtuWod0vN6HsCEbjIvQM1ma/aBxYmzNbTtVuqLbrPN1d2J7FoyyKi7lg7Gx/jyJN0+ySTdL3Wjg3QlbsYjEVm5xmqJ"
            "QxUwHRwcqInc6eZpR7vMzmUBdIWW7b62vKKbL8+CU81QKOujA1GPMSQw1NUd05nIAgzTFY+1Reo/L+XpSuCM2velpvroD5ct/h/O/3QpmsryRzh/+ertU445r9bz003L9Nur7m7kJEnBmNPymNTYNFN8qtHkZ0p4"
            "1ug9f3Z4uK8xzZSakJLma0xPWpi8OCU1Pi0tPm6MIWFxSnKqKT7OuDTBtMj4QkJSnHFhcpIpISk9OT2NBZjAbft/2r/7f6Bz5AvC/799/2vYDY3iAOe/f/+oF8cGL7c4h8iiLiFZIus1nFrsf6pv/Fmq2nz9Jv8Y"
            "TQZK7HGNsoLskjOG8oP5CSjg2L7wna6bxjUszV3/sd0nrkf0v1uWfCKj/qKxeEmKZphT0o4dxVEhWdNnXrAKHf7KHr3u3cyhJY6fnNoWHJNfMu2yX+uiLVrnky/bvX7o0+hVy/I2W7Z4Fg6E7fWvPTAIbbyxJCfX"
            "c/3fLGPXfCYce6f+n8nyHtyB85o2F1meO579FCwO1nfhf5t3RzhrqiUU2P7ILMKr6Hsr/ftd0F5a3hObtl1cF7QOn9ql1ex4zL7+QFb1XK+hhtppJw5dcWwctDTNNWBOwSnfwxVaT8W99lL/Oz74ylcNEelLy196"
            "uNT/vRfTdf0XfLZaFK6NCMts2f/M8bY1hWXFjz41/Oy2hNVh5ZFHor/o2Lrz4NaPz2z+8s3VJ05YfJwVdjj6rbgTI1o3duzzxE/r13gHxU3sj4ianNFStWnWqQ3DA/1fd4/6sG5h+vPfnlv6vq/xoG3y01V+C/Xf"
            "52qvZMz+PGWthJKCH6q5tFo346HBIZdCVy3aVL5bJ/9Da9pqbbRJ+U34P4zlD3MHjn7y4Hez+ww1VvSSfuf+H7K+9jVNn4xOKDeWjYZ8aXZZ0nxIn7B/MjLryYr6/CE5ZzfbRg7MzFgxR3p4u1dmwasr/zgzLjo3"
            "Z/DXiccvRmYe+OjsiLJId79VKyWna1p/l+hJZfO7NpqKd2/pfgFvnrCgqrNgnceaErcLNkf/UrTXYe3hBe4zzqPtS4qOJLxTVbTs+KG8q339TjlZhSt7baomnt5t+ORPX9XXZh0+O/5ybPyEQvSFT3HsyfS9Fplv"
            "FCdmF5wOeGy+3meWv5/34uDR+z8/3585e9/i6pI5OR+M++ztiD2z5kZlB9o8+1DM4+/NyCrKi3XY1j4zI8Q7IklxW2E7ffcb3vmfb9lVctbq92lrnwvPrwjvajBVrylI+nPYnJWPvOaWm/NUhPPfa+O/cdnvs+Lo"
            "vn5TeNGGXFz37ZZpQd+85jA5uGO0x8XD1o2XL9n+6GW88U/Hd98ZUnAhYkWo9NxwO1nb9VkMmU9J220H221odGq0qkms3Lhq0XK94dQPpzN3fPBqW1CkY67f8srpx7757uQrf113PHVo8cpBcc4Zt+t/6rNwls/n"
            "/J0vu4xwuvpRrCRB6YO3vSlb/8dNWbkuK06Sg4Jksusjlh1/p6Ely/cgJSBMUY8sAgICAgICAgICd3j+pwcr/h//XuL8D7UfuhXsCzlG/r8fcg9PSEw0xhqfSc4wJj9rnDDemGEMMi6MT0xMY+e8cZOUdrnTmh7s"
            "QIFk7uJYh5AyZiYc6xQULinqgVRAQEBAQEBAQEBAQEBAQOCXu//HsPxyzh/VOffK/oVF2ZIGSj1/ev+/bwLc/+Hjli8AHp87O0zJk89p6FcAoEMyd/EVAMaKeyj9CmCerKB5wj8CAgICAgICAgICAgICAr/o/Z//"
            "ijmT889Uda3Y33YoXCJ/nOjxs/s/uf7fevsPGA+AG//5QIVc9bX0+n/+Lq7/vkj5agq9/seIXwD8V/Av7l/rmA=="
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
            "eNrt3V9IU1EcB/Bzzty9YlrzIbOoOEZFkdU0UzMz7Y/SQ1lmf+ilqZs11G1udzZ66eZrEf2BXqKwiAJ7iIIeIoKkBw3qJQJF+kdkQlIMgnq4CJ37T11RzD+Vxvcj27nn3D+T89vG/e4OvVARVaItgTRKCGFEIroS"
            "7xkvSZaTkhcDhzwEAAAAAAAAAKYtPf7v9Cl1TnsgZLXh0W0Wv9hYg5kCAAAAAAAAmPn5X7IHVKttH90mO95Wi5kCAAAAAAAAmLm2xxTFWHCb/YfWeN+N0Kpll9UDsiw6bDYhRpshWqEznXiMrcTyyO3XZGv1r1pb"
            "TCAypa3GY6VajylbrWQ9tvlNBfkRNQ8R11vxGzyl5vph0bpcsvyWdqSjvEnVn+kL+Wb/vjW+vNx9u8ix9CY1u/HNyR1uMtuxleG6iOILc2WN4m/kK2p3VFbm8ogS9ociuTwaaAi2hMK+SMTnXbnI3xIKhhWflx/z"
            "K0d5kz/g5Q3BgOIPRIPRiH4witKOr/4FP9e/Lf/UZtT//6+/Q18oNPtN1nhmZz9pnVfzXn+fZ/psUvEjpTLiSty//IfWnveTd6RuRy7JkSr6Fopu7/zz5Ye/tNI3NCP14q1XQx+e3vv6supEwdXPtGfRt3qPvLYr"
            "E8X4l/UvNvv2F/3ka9sOrqZbnmXZNR1n/VPEzSH2YJTu0589KqeS2kHVDifmfFrWvySx/v1X0smDzjnKZOrPKHGOqb9TPUvVuANzPi3rX2r291jjUuzB2aF7TzLmTq7+bEz9meoR7wCY8mlXf6MmZWb/kjWe1saK"
            "B+8eWUepWFuV9IlZ2m9PzDTiolQT5xNEHFXvuMf7tGKUabxUs89WYcrqb830cWu8unvTZX69dxcVL2KypNLf3MzreH0wxoONfF0+j+l3Db7m5ohZ6PWjpWWTKW2JKK1GysSRylAbAAAAAAAAgCnP/7sT839PzH3a"
            "/W74MXUklf8LR/O/Y8L536HxYiP/lzNtZDUAAAAAAAAATF3+95j9mDW+vOt5+6yBqmyaItbyxPyfJ+J/3tj0v0EEfokZ6T/FSP/ShNJ/TqGR/nfj6j8AAAAAAADAH8r/1t/9V+z8r157Hd67gFOnWLssMf8XFvCY"
            "fjfmE4D91Tu2mTvq25Nxx3/ByP6eFM3+JAIAAAAAAAAApjz/q4n5f/B6PPJp68csKv18/V+P/wnpv8jlYhqRCBEbu1wTuPYva+fcRv4PObWR/0AIf8F35HRGjg=="
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
            *((60 if packed else 56, bytes([n])) for n in (1 if packed else 3, 255)),
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
