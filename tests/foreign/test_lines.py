"""A small tree of lines: the reader finds the original features, and detects corruption.

    pytest tests/foreign
    python tests/foreign/test_lines.py

python/tests/test_foreign.py compares files made by the program with the program's own results.
"""

from __future__ import annotations

import base64
import sys
import zlib
from typing import Any

import pytest
from basics import Bytes, Code, CorruptFile, Header, Unknown, spans
from lines import Json, Lines, read_column
from sealing import resealed

# Features, and their number of nodes of 25 line segments, in the plane and in space.
FEATURES, NODES, NODES_IN_SPACE = 40, 23, 28
# fmt: off
FILE = zlib.decompress(base64.b64decode(
    "eNqlWAtcFNUa/87M7rAuy7ouK6GSEhmy+LuKCNdXyqoIovgog6S8yiNMCfGBVD8fiUqA5ANfXBRFVER5qIiKpoagGYgYWNlD/BWlKakkCQoL2t5zZs6ws1vIvb/7DWfOzJnvO9//e84sW/0X"
    "hkfPj1EiAGBkOiC0ft5jNSiAAYFkzvFXZYU7UexbHMjmcTD9XwlDwR5YIoGHIhWGgJO/5nNwYhepSocYl6hO20Sxkwq1IT+42If1/CiFgTgYiDlL8UDJi0atTnou2QR4tC5Fpf1/R4s2BQTm"
    "2M7e4nhpO5w7NKfu5+fT3kdy2RBIRoaqIdPLnY73uWvbP3wjGnXHsaSQgd6eShhTFj66lGkZsPyUV/rWFc3dp0YEJ+cu93e57+daZcrlHD/6of6nD3ShvvtnfvyqV+i41JR5aX1z6oZnZsts"
    "dBtkcSVG+9gdl2/cdXmDW7Ou8OnxzR9HhGoLW2ah3ovWJu6uqb75ech4TdZLCq+6xI/uuH6507OkIvze24PBu46bYzBVTdnlHbli8yXdlOFKL9nqPivG+sSyMTWF9l4PblPmFFenVyrqNDfr"
    "bOcpmJZavN+ML14ICbyWsD8rbECNJiFj+HuVrS6f6Hcu0mGGth9U9Xs+XXc8Z/20cXZYbX31LISX8d7tC2J+KdDfss3aa/rMcHFqjcA1uCh9Xzf/vWgY3qnPovFEpHnosMXfQgy44MhsIdHJ"
    "8iiz9rLXsWLrCH2d2dh4oy/02NRFJJOSXr3jmBzhvBHNXAua2KohE/08t2zeNXjiGNdNm0ZwukYVRMztx92ZUv6dMW72kaMoLLXszddm55S1739S8qyoxWnflfKUV6b23dGqv5G2dmVCw/k3"
    "/Zhds1b+UVJ4f0Xl2WH2Z5Z42z179sLEBXOCH7/TOD4/ymtmzz+P5Q2oPRD0WXFwpN3M61sDwoKubQu6NhczNMcENdXmbZyCL5maPPfEoLJ/FNy7/MuI4Lj9wb/6FucNGOXx1nZ9ftTPePV7"
    "33yXV/OX9ca8f+wLWofyU2bkLytaVp4X75m/syov88HkkO1J0UGT3g2a9sTvcN6VsCC30rzMaHXBvaPF7mujg6ZxIAeRZJosUl/CQHdtKuRX0U4mE5XJZqWhrWwpWyg/x2TIH6Pj7HrOKFst"
    "b5bXsoeZW/LbqEJWwWTI0GSjXD/uJFvDPpIXso/ZF3PRDptPGMsiRaTATO0afIdHKwD7zITJR/ZXYuH34tqG4trDVfGoInvL5ewtuYqTZKEhDfFTcYZa4GhwFNaLXYXbYpVJoG43Bb5XTgnr"
    "DvEC2eWQ7S7fRpvJlP1Izk9bfnPmp8sJLsK+G2zK+YUAYbc9igPC41HYpg7yMLzLLB6Ktvz7QfDgkh+DkQLhHsU9byBQqzmUg+rRbXQB3cFHZcddIlvCVKKv2DVMDgNKvn/xND0UQe0OKA4x"
    "mgZrV+5jYVTrCP2Dh5L4OYZK48dhYdHt4BzqzX6/A953tTnxqKohYMjVw4OeeCGO41AxCj2DT+Hk9M4ZhDA6hQoszyA5iyssqHhiqUPrV9ELV9HDwlSqoPec5ZzFIo74iQGGwQOpnTkrFzxB"
    "vheQ71IDBjfTcBPdQ9/j4wxqo75Bamwlg0xfhwFKvKUgZuNn36Yg/gFONRXOLwYPooW8A/iDPClYx50v4ODhIKj7joHzYwh79XpUlMQdvIhgdwMDp7YhWK0n681sVr/GQYD/SseAqAHahNnq"
    "hHqDGkAFKnxWIv4tpcY6VQzRruaDgRjBZHKDUfFXMgaVFnDxv8uhujvsSWOh8C4DP13hUisY2NPv5hoWNl1igdxheYz912oZgQsnziPIeREK0lHGJLLweLccshfDoVKGf4ygpjuGf9M2qx/B"
    "XjoGz80sfwXAP+gAbsSH1BbRSAvrmtgmFinU4OCgJmaqQYdNVepAp0YeQpIJrmaEeAJxLCYSnsZUJQ8JU+VGjAwjIPo/ty/os+1lDMuMwmjGgkDloNVq1TiaWnOtgWeHEoZqqklkqS5KKDnR"
    "VtTHUzNrpfOp+23PqpEnxu2ahH1krd0ahxq0OoxDo9GqCBiGfw31lajDQeQYRoKKhxTfwuAMg1u5LI5iB29jkh12iRFj+6WbFCPCQBoHCQj5QFlDFSNBwtDEdgIZYwUdBgtqfOYR4zYA/BeQ"
    "is9BGijqQiH/GKUIu3FrN5KDwCcbzkB+rk5ka20FuU0VDGq7JeI+Ox/aWhloamFhzX4mP53aknFWjmjmEQuEhMP1A5aOB3NWdRhkPkmeCAcJhFblgA0j2Ye/+3jz1CoFUoIzWAZDkh4odW93"
    "waQOho27WPgtj7FIEAIY/jY/JJiMf+/w3gSVFrtao9agQL4n1R3UAkoL5JPO3JN6Y6AaASAIwHBekO6TVyeHqpFQvY7BXzb9pI1G0ltIV8GbOOFNSFOjtqoZ0V5eKZaOb0PEYN5mdDtHBn9e"
    "xbH8hoWiXtRkooOYiG2WxMkcDrNSXglOGi0udpWDA2iRygO/NIgq3AtO5CmO9ULNbDOLAN+CAqk6XjcCQgyQE8uUv+RBitlkwlWAzW93x4x4L3NA6hMQH6GLqUgIjWVYhHSSoqZaLXsVhqRT"
    "OpDIqDXYdUpcFkisWnOnIqEoPNKTrvN9M7vSrgNL+0EkvAXMEDr6lTQ9hRg5qBx1GsAKQdCEtHwOxp914O8eFNnxs5hbCa9L9kAKnD8q0RR7oWzBCY/YWu9d/Iv8SpPpoiPlwNf3RwnXMmHF"
    "bTCVWYvHXHSkTQWW5HwFIPgCSGTi3YqozH08Hpwc3pM4YvpFgD4jhXVDGgJjd0EP/dDQ77YRLkKJf8LTc7rR/cvHCnxRjgDbkqUyzvpnVGYDHp+264+STnQoDGDfLIFveDnuDwlSmVB9Cv3E"
    "OkqQnjoV14PKtO4V+BTVAGHVUh/E60dQMD/jkZf8cb1oT/9msz0/VlvY495bacZmHHl/EME2sR5BOvVBYwADg1NAao/7QaU5Po9fzLjOUD5be2E9NYSBof+UyhjcL1KZCXjM/PDcco7q6Xma"
    "pn0LAls7Cx+4K2itrMKjR4hHhIrq8V4nrA8/y0AIWNgzMInKkBScF9H8VMTmzwp89yYxsFNpEZ+BB6jMXjzOHDy/SkNlxL0XJTPwZKoFtoF+NMGi8Og+/5EPMS89n4HTawS+0i8ZOHPdIj4D"
    "C6nMcLL/6mPVcsr3zUGB78JLLBQXIIu83U9nNzovmQiXMp3WGkgNiDxETtQlSjMdrwQpuRg6qyO64ryXcg6Q6vtmjUG6i1Qf1eP2v8rRL3u32fRZLzofHv3dFyb0gYWcNG/Fehfrm5YwrLxW"
    "ERu1ONDQVc2LzU6s2/c0DZkTDrxp6KzuqT696H9ayjDXxzdztuMcg7T2pTUp9otuVvGIbR332YzuYwxd9Qy1ldydgLaXP/nN39BV3+hB+cVfTodPPxiR7CPIPa939LTyZ/8x/tkHegh++bv+"
    "Qfd3H0/5RbwLcl5PXD51gYHUttgPpHGn/nR3ofy0LUCDn2wDuIVayJH6tuwJ4G7tl/bLxgGTjRMMXfUs63ooNKFGU6ne0FXf4qz82RSnuXk+1GDoqneJ+UnthRtvc16nro83dNa/KN9AJ5Dq"
    "B9j+8MDJlLY3DNJ+JO0tYt9jrPNlt8/QadNv+XTV+zRW9lUeOScf5jTZ0FX/U1rpq4lIeG3kC6MNXfVAuVUc8kbXNhUEeBu66oOOYrzxBvcWlPi6QefEuO3v9TT3j6+mhE/3sZ47k3lqmk9U"
    "6BAn/2DewuhI4GLiFoRHLkGypZEfLmXkS5fELZ3HyqJiF8bIbGIj349cEhYtpxAbfeC/ov+HDynneg56N3IhAcDfb+3kn8JlDuYEChwXONk1yXSsnmajikY5cOo03/OH5pQ1098GChqVQL8J"
    "Y5f1uF/9VNgOvKjywICpM7zyx7p60C4xn65PmfDGWGZVa9EOur6Cru/CY9ulh7nKmPnR4Qv9t/4HMbKSWA=="
))
SPACE = zlib.decompress(base64.b64decode(
    "eNqlWQsgVVn3X/uc+3K7rtN1R4pyJ0bphSaN9HA1KiZTZny9TDMj1VSmlDC9CxG9VFRUvpg0ioi+IqkpYga9Rg+TSSPJRE0q1ZBh8t/7PLju/Pv8/9+3T/s89tlr7bV+a63fPlexk5b6Ll7k"
    "L0cAQIuMgTTJo5ACkAEFXBNpQq6KsvajQG8JiBZKwPPz8PfBGGj8ikyR7QR7MJ/EFIE5vUyRb9+yXJEr9aM/ylLN+qW/8Zx31m+hYBQMwjMZsgjjOzY0UjrV7mhQgRU8RTGmsbLJW6wmBrwH"
    "PvW9Vq5cmbUWuShEvkyg4pZ98RCDrykr32g0+qHpgiQ3ul/YQEjqGTm5fVUPv6PDp5bYPw3a6PbVyt+/MPqyMbpmmK86VvP7PxsqzSsM1oX7mm9bcs06o/DhlZopj64NCZ7cIzP0Xw3WcRWy"
    "llnfzzowx3LLvLURoevzNyr966LmjgxzzFcz0gHQaDTJ3Oto6FbtdQjwHMFI4ylhZKdFzoRnr2ttTxpoxxeos4Zq3kRaRtvcyp9QYlR5aMVaVWhBPMIiduLFPWosoh1TICXE0RFhnVodcStq"
    "o33ywgHJEq/8nBDHgX3i//w0aq7cYVnPF4U59X0TXX3svtIop0DUxkPv/i+6NW9cfLRtHfaMHOY2UKPcIina4FgTv52oI08p59U18eMNZ4e3ZQ0NcYxqv20StdEYGolJnnSvd50Xb61qdBdJ"
    "5koCQmy05mrDAA/kERpO1SQt1Ly5zxkDw6EvDpUDidfA/gXV911u+zMNBkbJDSipxhQHqWxudKijpDZ+rIwqLdb0tm8Jm2dlEWu7ai2O/wQ7K5FtcV8IzJH7+wU4fT70xOwCb6OZK+4Umft9"
    "+ttXZop9W/8Z/N530buH+ftmfvN67vrGhh2PtqlXVzqbHurlHLt9dUbRGT8L5ywvpi5tqMQl4Zik1S3hWFPj6LbnhUYXVuPRdZYfJhz7MSLEcUbDg0kne9alXdW+d23ahzIPMs1s3NrXz+8X"
    "RhpZjDM/cRBPee4UcPzOSx+i9ML9QhstVrBkDRYKLXXpUOssnOrGW12btsbeuC7NPn3q314P+GJzYPlrK6xv+cSa2dk77vELkRUdK1R1ad8OIeaF47t1bZvYF7N74YVvbcSnwIGsCVe34EtI"
    "W1RgebQFVlT8jNe/YSqWOnHr3WvTLCfpyJMVNhB7MsaNx1D0duWN+pDCwhcmYF1j8rBR49aDC9jhcAXimHmGULY7ZxwyldjWWSqaIbfY6mKOiYd1Y0vSIwrUbpsiI6WjJf2btcuNNF+++M20"
    "SPPQFKwse5e6XatZO0piXwwHy+7urnoqgvwLCcF3Dya+ipjC/LRobkH85dFT1uUXP65rOhcU95370+9ehlhlB37zg5LKGzeJEss91CYXnrSEx0isx1gtrS+WjAhYUPn1g0kHeyw3inB9nLd/"
    "zyiXZxOvn7WZXjwzdfwJ07XG/Tae9ls6cPiErSUG3g7JlzJP+UW6JSRNo72YSYaa6CWj3Fc5Z9w5cl+UsV+9/skPnw4Ns0kZ6fMwVr39D40qd1VeZf2wc9Nu2s3Onr79/cd/nfKz/a3/3Ka8"
    "Jnv/qbGFH2TV/LqksCKrqnVR+d43n2dPNwwNCJtu6HGmJL6h4q+PjpmoG2Z4OzBGS8s1zlHJEqY4Z1lPivarFpWN3m+o6acNKvfOnouqph6bvjm43NtBf0qDU8SXi8rvxK52ztgffOn5dMMX"
    "gbvs13zeWl8yj35kNrPxac6cbWs/lPl/OjT6YvPgjD7xL9Z7Z8ct5+eImMLPHB7MeHZk2rGcJvzWw758G9bUJz2y+WbaJzd3+H2S9sOKrE/oqLmf5cpC0QfPRBnev/lduJG2ausrMh078f3x"
    "dUHzPKI1dMbKFQe8L2L8BhNXPV9f/MyhxKjm6IlYdVVawW6sz73dyeWYJCW+v/M49+sAYhCaiEkiBc51VCctEV9F+6mDqEA0ey+KpfPpLPE56oD4D3SS3iZpEYWKX4kr6QzqgbgWlYhKqAMi"
    "NLlFbDM+my6jX4iz6D/ovqlon3Qr1XXrQJAP0N7KEOoHeI13mb/acXMW/b3R8DSnsiGnMuNKCCo5HFN6OCZVlk0GGvYi9pJzQMnNaDDlxnOsucccRTvXDO5y8947zY2bhHDNMIWoK61Fu8jl"
    "8Asxe4l5pGEvpeH9Ob3bpcXsgDunLVH2Hfd6NPapo9lpF1AB76OYuCfTbc9XTUcyBJRI8u86AqVSglJQPapFF9FDfFzqeNpEn6cuoRt0GJVCgZzdVdnm6YOgch/kzGppt1WtO0TD6NejbJ48"
    "04mfqY9u/CRYWIAdND4OdMU++MZaeurFlQZ3+6sZw5pGIIlEgnKQTx4++ZLTvDyEsHUyBXQ9g85ZGKFBwTaaB7R+A39jLSDMXfJl/LOk6zWJRhKCEwUUhTtSaiR6EDQh14vINUiLjZupvYse"
    "owp85KE/eWyQEntJofbiMimgc1UzANXUOhDnUZHx3cdydN8gI1uMGDzCgAp3DAhFDgSRAyC/oQ+0Pxfhl0fPDYWzMX0hdj+Nn5KaR0LBoV6QfVcMKGpA9S0aQhpFLKCs1s4TuuJ0PFuMl6hK"
    "lOIzt5oclKDAS6mgH4c7vmco4iXnZH2MNRzBC5KlcWNNb7uzBGK3yiDxjZyM1e7qAajqOAXRrYaQ+ZgEE34N7QmoIoOub6WJNVED4oOPFqLcXVTJPSo/lwJUaFxozFpFbriDMzIlWnx+o4Qz"
    "8bjrj2eI5qZkOnqf6M0lmrWYAYVKrVIxoESgAcQCxGLY1oyNP7hpyl9nZdh7ggTq8J1oY53HHiuwt8AixLqJki724/1DZef8ebdQVLkr7w3q6gLqYjf6m6mIUZrIlSoE+B82MemkJQIMGYKr"
    "1QgBBgArwHLY0MYmdxJ9CrRC1iMQsOftSkxAcCGXrwpUfS0MwdZaqQA9se2KE/wcSUEWBzweScIiBOMuoHOxQJ3Z0Ik768W1agIRB3FX2HFACra5YVcYpVytUmP4kag/AR7Y3MwPH1u92Zy1"
    "Eb0qHZNYrYbYNgWgh9+OTbzeG9Lwfo2wNcQgAiO2QCcj8XrckhyIJPExZCQniXKlwAZKAiXFlR53lZPkxK5ejsfwVFmwMIWk9IV7f2ogCS8LEFJjAHDk4AfkEW3bp4HYhp4sbLvzNbDjWyO4"
    "fHII+7xjCpD6Conrj9KKHGHPbWs2dZoqzKC4zgZ+vjkGdl4QQ/MeZ4DmUhFkHX+HhZh0ArHgGbBPGOTXpaKoeDE7pIe3XkHqpX6REAXuzEZBFx22YNlRXCA/v5Y8bZAKLzBpMGBiQs6mChNG"
    "zigxkEjEwafAmxiuborgiPj0UlMClDiEId87kxASDAFOtw4HYCtib38WShzZI4/6Acr9dUxWYh8+88rqsdZ7P8igMtESXpYxZPh1tTWg2ifayF32LIIAZ3/FGNzDqo9/PwTKMyxIkpYUKKAT"
    "PC4/OcTiH4oF9uLSl0zqqODIAdzRBTDhBB1FzmG3cwpWjJXgrOeA2vRApst9HKxXnLjZhFJMTFRKilGQ/GNAjZPQifzWI0VIUgyzAzq31R0qr6hRzFb8o6+NQjoBJmtzijkClyP8WxHhHEX5"
    "dftIhYcUGZPC/AXXOeooSSQQiFBpSK5ikIwlAz7dUcjm1QI1XUmfCXFpvdkAoP11Y+DKMTGbmagz+3TyjWCFdBKHhYTLExUahBhUfyAJoVObjVHYDx8RqsbmoF9CMSEhc1CqhdrDhphSAimh"
    "/O2nEdw+KMuvsiBVR9KDyxpUv3EwPPjRMuquad0rWzj3ylqg0fQaFWDo7yZaHrvZC260q/jcIOEBHHI23l3TQSDYriEmMlzccDA7IslF8IpTbSZqO0zt3k9jopIBXw5qpGCd6M8SChsRdleT"
    "sfRanZrLUWYStvT2TQ07JeqoFztWUfQevKwbzo5hhiWt9TAFpaW92CE9XsUJzLrThW95Pu6SvTgmnJnpO0RF4eK7LeJXTyWcVx0Z+/wQqQaSDEolg5NRqZIr0Tgcl+qfyhE6/HwQOv+TllAQ"
    "4hgDyZECf5mQ2BDzUUK1B/4QQMRu8gp/ShFaxYFkPydEXBDjgkngSGrdu0WzXuN47cySQ3J6L3JLtAA2smT7JLiRLuK3lfhgEi0SQLyATuXxPqITmR437rgdqPb49vlEfHP9jhs+Pyv4GIFc"
    "jj/u5HKkJrZ0tH5dNjyWl8iGItjVMe/0lmGAsmrxl3gczpiOzQ83su2hkt1mcDJHpKP49/CJXF1wtv5tI+xgHO5Gr270D919nq1xHX7hopW0XZIbJi1rltY/kXGMgwiVqNUqRoHjqJBTDOqn"
    "Y5/w7cE3NrRdXtc/jERdHAWUsFvF1ruOjn/r2tFTEvRWl3CwOmnhbZ7gPRSZgomSwV6Q7V8ufJ2n8r8lBuJusypsCDv+NKL9YLMcFhlI2PthMxRgf0YCXFjcqDjeFxvc3Rdm5FPQtZ0qwjxw"
    "1hB2FBjwvxDcqev8OoG4qy7FjJTqyZQtFsFhpRSu7pPyMpMpVwPuXQ7urnL/yB783B93KSBzMoA6Uwwl04zA65GIl/mY+pOXccR9vuIDByHzarDxo8QysAvGuYo3s07bplLDeX/m4x4d+aAR"
    "ew07y2jWB9c9Mta23GFGsHCzAY/BTCqflzmBe9A/6lt68DJZXgzEO3G2XeqtgjNjBRlghhsJtQJQeOJUGMmTVxI1rPycglt2AD7L1eDtS4HLJ4JtwATwTn+J+5kcjyQyrvlWCjcuiOAjXM3P"
    "DRUwO04Kw81kvAxiyngZ/KkHsUHXbNX4XjveCJQTKPDCwN+yMQHfnTLwNBFkKMbUkJMZi2W85nqNIH98JT4Q3QtuAbvOUamRzjo0M03JyYzDPWVNYQTBukxlDNpnUnBZKgIm0xj8w+SQ6yfm"
    "ZcRMLC9DiNgw9ecxRKZ6lDHrN7GH4AEBuhhImavKzvhEZNu8kfD+HBpiwOZLSJUR5Pgp4EihjMdaxvTtycnswH3Piyc+JP18HpjAjxo5i0HShl6Q8I4hXD4trCNjPPn4XMZ9qfSdbWTLIVj5"
    "nwd405cCO08zSPeWgcRDwEDOmPEkWIp7pq/pSQKjVYMJvHhmwK7DUGaQv5oBoyM0L6NgapnOPEg/vSmP5MHzk31ANVsM94yxpZV94JWPWGcdJUPx/piR8jRMCEW8PyI//I0db8CuSe5PpQj5"
    "xjDpvEwrwW6N+Q2Gj6lpby5Hs3BypfdTwbVWATdT5oiK3+twH+yneWrI2+YWzcDEPQh2f2IBrrNU4LTAoKN2k6GTQ0jbef2LL1sexWkJdwhzBDlSdwI/DuKvQl2fH5Z6e9CNFV3khDoicgLP"
    "UJ2syeXsS/mOhxZW2rfxFj+fEuwTqNjqtl3yYPsVWl0e0l2P4w7t/1tO4Mm+/DvhzzVvAnpMtniw7G9yhMN0uVLgRmEbPFWRnmGzbIK2O74UcBQ4L6bPhNebIj7SdseZtB6uQcu/SWl+f5S2"
    "O96U6MXhzNkN5r9EOmq7484eeuvt273Hx95xlvZt/MnrZ1bx8y346/2IoFT/P3ZpyVxSo6TehDwjdU39h3L0fygn8Pwofr4xf404Gn5avG4FK6fLwYRPdblerBc/cWhDKhi5aLvjezU/X8ib"
    "vWbrY/r5eGu743xjPblPL81ZlJnwmbY73tfPl+k365f5oNHa7rif1suXvFFV9W9cLLXd8b9Eb72vo375dduYsdru9gBLfr7AVKfowOQhIzZqBU4nuBBOJ/ysuw8oBPz5K/PVioSp7Z7a7vYC"
    "Q7347XWwNXVY5qHtbj9Aeri0jmjS3DBpc+5uT9CXezVrjuvgirvO3e0LjJ6dSVmm7S/dZmi72xsM9dbLbwg/uHqlp7a7/cGUv+7CbvinLrg8EN7eqIHJvYd+aP57zcg+zvrXt8m0tVu+Issg"
    "iXjFwqWL54PEP3iJ7/zlSBQ0f2UQJQ5aHhy0kBb5BS71F0kD538zf/mcxWLeiefO8H9q/808JP/q/WEL5i8lBrDPsW/5f+7dFp2J5zHeY/IaKuvrr/kqdeXZxWPKVNeyHvNMMnvxf13nq8Nj"
    "4gSX1OGp8p/4XWcEv7iH+xSvd6zyEmj+R8sifvzjCf9wcR3U/nAxP76WH0/A/fbKSiT3X7TYd+mk2P8BjHv2wg=="
))
# fmt: on

both = pytest.mark.parametrize(("data", "axes", "nodes"), [(FILE, 2, NODES), (SPACE, 3, NODES_IN_SPACE)], ids=["plane", "space"])


def feature(i: int, axes: int) -> tuple[list[list[tuple[float, ...]]], list[Any]]:
    k = i * i * 7919 % 1009
    x, y = (-800.0 if i == 7 else i % 8 * 25.0), k / 8
    lines: list[list[tuple[float, ...]]] = [[(x, y), (x + k % 5, y + 0.125), (x + k % 5, y + 9)]]
    if i % 3 == 0:
        lines.append([(x + j * j / 4, y - j * (k % 3) / 8) for j in range(k % 11 + 2)])
    if axes == 3:
        lines = [[(x, y, (x * 3 - y) / 2 % 64) for x, y in line] for line in lines]
    strings = ["", "Strasse", "Stra\u00dfe", "\u9053", None]
    mixed = [i, i / 2 + 0.25, strings[k % 5], i % 2 == 0, Json('{"a": [1, null]}'), None]
    return lines, [k - 500, i - 2**40 if i % 2 else k / 7, strings[i % 5], None if i % 4 == 1 else k % 2 == 0, Json(f"[{i % 3}]"), mixed[i % 6]]


@both
def test_features_come_out(data: bytes, axes: int, nodes: int) -> None:
    tree = Lines(data)
    found = [([[tree.world(vertex) for vertex in line] for line in of.lines], of.values) for of in tree.each_feature()]
    made = [feature(i, axes) for i in range(FEATURES)]
    assert found == made
    assert [[type(value) for value in values] for _, values in found] == [[type(value) for value in values] for _, values in made]
    assert (tree.axes, tree.features, len(tree.nodes)) == (axes, FEATURES, nodes)
    assert [(of.name, of.kind) for of in tree.attributes] == list(zip(["whole", "number", "text", "truth", "json", "several"], range(6)))
    tree.verify()


@both
def test_nodes_summarize_what_is_below(data: bytes, axes: int, nodes: int) -> None:
    tree = Lines(data)
    root = tree.nodes[Code(0, (0,) * axes)]
    assert (root.segments, root.features) == (tree.segments, FEATURES)
    assert sum(len(segments) for _, segments in tree.walk()) == tree.segments
    assert sum(len(line) - 1 for of in tree.each_feature() for line in of.lines) == tree.segments


def read(data: bytes) -> Lines:
    """Returns a tree after reading all of it."""
    tree = Lines(data)
    assert sum(len(segments) for _, segments in tree.walk()) == tree.segments
    assert len(list(tree.each_feature())) == tree.features
    return tree


@both
def test_each_flipped_byte_is_noticed(data: bytes, axes: int, nodes: int) -> None:
    # A checksum covers each byte of a file.
    for at in range(0, len(data), len(data) // 500):
        changed = bytearray(data)
        changed[at] ^= 1 << at % 8
        with pytest.raises((CorruptFile, Unknown)):
            read(bytes(changed))


def test_corruption_with_valid_checksums() -> None:
    """Corrupt bytes, one in each file, with valid checksums: an error, or the right number of
    features and line segments."""
    assert resealed(bytearray(FILE), FILE) == FILE
    errors, offsets = 0, range(0, len(FILE) - 16 - 36 - 24 * 5, len(FILE) // 250)
    for at in offsets:
        changed = bytearray(FILE)
        changed[at] ^= 1 << at % 7
        try:
            read(resealed(changed, FILE)).verify()
        except (CorruptFile, Unknown):
            errors += 1
    assert errors > 0.75 * len(offsets)


def test_other_contents_and_numbers_are_refused() -> None:
    at, size, _ = spans(FILE, Header.read(FILE))[b"LINS"]
    for place, value, error in [(13, 3, Unknown), (12, 3, CorruptFile), (14, 2, CorruptFile), (16, 1, CorruptFile), (at, 1, Unknown), (at + size - 1, 6, Unknown)]:
        changed = bytearray(FILE)
        changed[place] = value
        with pytest.raises(error):
            Lines(resealed(changed, FILE))


def test_columns() -> None:
    assert read_column(Bytes(b""), []) == []
    assert read_column(Bytes(b"\1\x02\x03\x80\x01"), [0] * 3) == [1, -2, 64]
    assert read_column(Bytes(b"\3\x02\x03\x80\x01"), [0] * 3) == [1, -1, 63]
    most = b"\xfe" + b"\xff" * 8 + b"\1"
    assert read_column(Bytes(b"\1" + most), [0]) == [2**63 - 1] and read_column(Bytes(b"\3" + most + b"\2"), [0, 0]) == [2**63 - 1, -(2**63)]
    for changed in (b"\4\0", b"\1", b"\1" + b"\xff" * 10, b"\1" + b"\xff" * 9 + b"\2"):
        with pytest.raises(CorruptFile):
            read_column(Bytes(changed), [0])


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
