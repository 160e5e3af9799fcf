"""Small trees of points: the reader finds the original points, and detects corruption.

    pytest tests/foreign
    python tests/foreign/test_points.py

python/tests/test_foreign.py compares files made by the program with the program's own results.
"""

from __future__ import annotations

import base64
import struct
import sys
import zlib
from collections import Counter
from typing import Callable, NamedTuple

import pytest
from basics import Bytes, Code, CorruptFile, Header, Unknown, spans
from points import Number, Point, Points, ordered, predicted, rounded, value_of
from sealing import resealed
from tokens import numbers

NONE = float("nan")


class Sample(NamedTuple):
    """The original points in world coordinates; their number, and that of the nodes; and the
    file."""

    point: Callable[[int], Point]
    size: int
    nodes: int
    repeated: int
    packed: str

    @property
    def file(self) -> bytes:
        return zlib.decompress(base64.b64decode(self.packed))


# One point of each is far from all others, so that points are in several levels.


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
# An octree of an array with a clock, labels, and attributes of several types; a quadtree of a
# table. Both have nodes of 25 points.
SAMPLES = {
    "space": Sample(
        in_space, 110, 8, 0,
        (
            "eNqlWgtUFEfWvt09wwwPYUQYEBFHRUREHSJRVNQewDerbAKKCjr4AgUVRQOJZm1GFEMUTPTsqtH8aIwxIDq6YjAxYUBX0fXBGoyJmixuRF13g6hJNMY9+W/1ax4Mw/7nr3OK6u6q"
            "unXrq/usYduE5fNyFi/zoACAYbyAFGZL2PMR2OqxvoL1faz5WFPE96dYH2At5Ec3BzewpNVg7Qo0CIWysL2oQ7nwmYo9xvR295uUbvpzyNR9ZxVVQxd/xUCgPBB07Lb7eQtrtmX5"
            "giYVQAublDCPgsbdJvfKWe/6fbEh/HMT/SMlDH5TnDQY5KLhzu8tvRYF9P2Lo/MuKYBzA1AYIRI8sTMa1DqW4YAWHuDFi6elzVN7epjoj0WK3UUyq3mOKL7qy57ElD0JnFdlujC/"
            "wHXZFBtm7POhe/lQatWBy0XF9kXVtJPyM0835KTM9gdNJOg9oYGGalyDZVigoiHQiMzRHtEAodwl6nLPPZDyfIYuZT09u789d9NkvJRfG3qdbolKDmHuRLEhp+NbopJC1rc8YgaH"
            "/y5mj/u+ob1Xh22/XAQbqj0KKulbFX6NGRSnSgMIgEYlTg8CFvZS/INbYDkFM1p7qFfuegDupw7UAT1aXuanmLAyqikqFsv2kW6plfC4oHTUqjDL++7mRaW59dOV9ZVxhUo3UDOs"
            "z+gguLvjA6q8yDcIklikfn0wBccaGPjbpQMrTPRuT4Gk6v98dgqNiBN5gO4j2LLdM40ehcijZZ1AQGC3nm+7kLPboS+rexwYWma4HmGO3ahqcH1+z2LDuLg97j4+PhVDb7sqvX9O"
            "3HO+rmi2f6zr4nekhHMPgK1KCMGSQ3HFLgpKO5RTXJxHDxTOcspY794D4Pp/QmH8kHy41f+WZy+gazN/2vfLi/m/nggwiUejLxVaBdTy22aw9igY8g71OHBw2d7HgSHhZTaMF+IH"
            "mxJWdrs3+RJdRh1MXFx/+kFi7h73vR3sPWPVIlAdTtF1uutYy/QUqtATLDT4uCw1wEYiu43QGOfZBQYdFx++uXfDZ6fqO+r+zcajjeZVL+OQvlgnYl2GdQrWSVgnYM0Q7Y5JkJ+e"
            "trZHKlQj+2rhPyPSlfsruVX+mw/Tsdx1eHHkK+zyscqeznhFkUrUlnJD/XOr8oIPP/QBEz1XaW9qQuUZzNZCCjd4BdUXUFCJWQnCI9CB8IccpiCS4WqkM4KxV+FJAm9YAxqLKBmo"
            "S2hmWTfoBGAdw1LKDhebVkhfDbdfrb/M9e8aCNd1oC70EpZRMDoO2tNSIy2NGtbTWrDVLYB+MqnihvU842cgsBmI7ltoT+eE1ASBbAfF7ysTUm7ikbyEp4B0GCNHdbg3Dhs9K4k8"
            "KSOFw8B627xBAPIMaO4anIMYyTTXqXo4pa5XQ0NfH0mvDr0tLTJLXmCCbivlWqSvQHh9J8fHNFuYHh2h9OaiwBj8MogcFFZi1lZgHYV1MtY6rOdlcbfYuFqN1YOy7ITl4w9O+XR/"
            "fPpVKrTnqIzz3kcfeq3Zc88zmgF/6zg969Nbe/TB6vxxkfOYQGPVjYoTEa01rcrcXhNB2fPkGBMtyfybshRRkk5x3Oi9r0UPy23FLTDAUcDBqQiuygN4UcIBJyJgjv8fG++FhI6l"
            "IFdnJSaJ5HRbD5uf/For3Jnaesd7IrbesbFJrZbTzspdbwHFta0KPb+whqWy/S3TleYUinejKEOWWdUpS1NulJup+n8njX88MKzbNI7OGmC//ARgpL0Y++TrVqr65P/oHZvcyt3x"
            "ziV/WMJHVivXUgpaPTQbAgECzdMLc1Jgtr9PbDQvfFMPpbS1lRN7iAz09m+Cg8cZeP7X3m/9uQ/QwTxxIvPD2rgBbkf/nWM2MKD0i4bkJANhlH+PHPgSbKbHwIbi4r+ce9r8qDl+"
            "kIk+6qApoTLuUIC4H73mndOKJ84g7CycqpBR5+BExBz/C7p7If4I+qPxxDVyY2zVt4Sn1FVwjflsnio037JSRVxBZH5zO4tfl6eSPIVpdOHpIi9w6T4nulmKug0TwxmUr95HPEI6"
            "K/Mq6R9+/kbNHYiHlB9ifht+7F7ivUF5v/xFN9hc+L2npIwJZZIy7uSPzY1sIDzpIYuiktZqYYjY8PISf8fbqmks/219i/gpAV/jK3tuvfVPXacWVk1E63qEy+02V+H2FlWObLO4"
            "cUSLN5D3P85Q/utYd6i9QcF71Gsffld1d8c/1tarhoiGM0FU5ETxOQ5rNtaVslKbQ6xK7Wnrni7dWrQqjF1Cn+aUVNZ3eUrGxsWhLveq/D52+jnNg1RA4wnj+wxnyugxKhN9OsRe"
            "h3W24RYFFjQjCCe66mOIrhBdAR9toT1CHnJYtNyrfe11J8zqW3ONFDcTjFqMcXSUt5ZT4vtcFDZjoVIwBCiZJKgHOKVUcPSkCHtK4TKl4VkYmaYCF8Chw/XRQjkJ+7nimUiEo9xs"
            "aO1HWo1eCobWWz3xO5kUzAFegLVQYFEC10sLHB91Ye6QRib7xBIazaWjCI3jSEPvrjDRv7nba1qIFR01RyE45eAmYsNnDY7YEHe01mCrYQmytxi0NYOCdGD5+K8Qw0CUGYsQCXZU"
            "3qeQbHRjI3/6GBcBxOATq1IkhL0k6cLuTZIuJMrL9o3JxbB+NjQXal2qqFnJmhK0fDy6RAhGVenksCxUDyvAgcQ2MYqL44knGiomeRuBmBfcrPh+FWuFLLRtNp7IWzasoDeOuvqv"
            "8+9PPF+6P4Geq5k8ou9cGvQt5xcX7qBRBORxrLHqlY0X9F1WbIqH4H+gK9OiSJ6hoenLR9oNXSj4tm9N9swjGEEw9rIcabWLGiOVBloWaCPJUzGCMKNssUohD1Cjc2iroIl44wZn"
            "cwzULtdUPbttosNoe3lMl50Sk2SkksBT10SDheJj2aNkQagxk0bnASxlGQAFqcpcC0VSjZrpS9EZuCyNszFlJjkePK8rpUJrj8BnTfMKp3D08EH2XKTKTjogK57iwsFMxCaZwlyp"
            "rdnDyEVrSfbGS4yRgtlAT4yjuAFE4FnSFhTkKmEfhBRgYMGN/qqiSjLDuZUemFMFZWHS1fKfvmObVMyi6tT3KHqBNU8PnEyFCyKk5COdjwH8OFrOW1QzQIM0wiTtCnkXXVC4J9gM"
            "KU4GjWc5nVv/lhs3oOR2Sp3guJkcdNC6kvAu8MinlXr7hjv9wZLksya62MHXOZ5pAJ8CkkNN5ahy0EKMeKgKc8ojPFM+eIVZJjzTvwdVPcsgPq95rK1G/g/fevI+L4mCCNApUXSb"
            "DX6d+IAztJpj+JOvIWy5JR4ETlIvjdJFHEiiNJK6hqVVokPu5Mag4FkV2kSS8IFfKEc9PBcB6d8uGpj7W0zNkC33+v5ac7ZQPJzgLZLic/yOSP1En0RZTjNDoK3N4iFIRDL5MFDg"
            "M0li8yOYpW8Xux4HhxgrPhIGJe5HO1roj9i0kfTtkGBVDQGWQSeyrE7OH/h0DVr8amHVhTTq2TvJD0tLR4i+YZqYlaVjXSC+V2LdKRuMRqe3RJBqfJtL7ZOcMH6BgivhGtSHn/SD"
            "pVtoGPek3wAKfG3d4e8v9txS9VqTN2AcyAbCm+99+s3HS/UYtD53CFoHWp0Vhw7vMnGBc65NV0oBK/XzxZdfzXQDnh/xcgjGTvkS3rl8AH1fN4eLoTQ5b0sv2GiDKEkDueollTcq"
            "PFgSS8MJNI/Ju3Qju03NrHcSyD5ItJGBwD3dBZoo2God4nq1+5WgT+AV5WyOTnFI5UZY3V4M7ucMOvD11R7zKk3FtyoUWfzSn0RAWtKu5pHd4jLj7icW6G2od01A6mdffBG0Zt+r"
            "SopOkontaROz0MugKd9WzZuMlUgUdf7vFfSzBVXksfjbCl4ccAH2bzvXhBE1Oc7fc6mu76TIafbd3EhUErW8tMSt9eOJShNd4aDh1gPBaJaCSyR/nkNCeDGWpX5O3HNykXwgfEwC"
            "ycFNMPDgAeCVwU6918pxtmFX+/SsDnbk1ruBAnVRiG/rPulYIxuqPDj3p3gwwF8CuSi1Vv6EmHfXG19AwIkVEL5u2PHazS1e3z89JTns+/INzQo5bf3l9bdlVutAc8dS3VGovLbS"
            "9E1FaFYG4n8ThSoiRJ28q2MXM7JbSAib+SBRY3PkvKKmdFkTdPLg75U/ds9XRYmXuWNEKEn8Eis+x4lXEyYxHrKqaRerHlkwyJsF5VrAcAY0Gj5K4WQtllov20hzhpigwQdvUPDZ"
            "GwrUrE3d7BU1SB4+ormcwjhVEUhCMDWJO9Tkc5ZIHXNlE/3A014tesizTzbvI7M9UnntcDq9/Y1qT3l6V5ZfnNbzdxKnnRPg6B9+E8o0cVqgTECh4QmQvN7hkkGoJrrcw14jrLwP"
            "/1qYpEPe65wvbXvfKdyABMuw91prJtODdYT3DvY+lJEcClsoUQmVjZpnJE/B5FtmZ9ucUkok2+isCnc1bb0aWFbeJQuXo6Qnyb6ycKC/9LRbxJaFVrX0Tdq0RCWmJFKM1we7qFy7"
            "ixJ1u/xH2o7Ar/UMJZEUTo0Dbs1tnqunG4QsoZPRRcKoUesdR9Pq9qOlMkDEwDVtCR8pe3I9ukbUFP92o51zIgkXx/7XfIsPm71dcSKVQ6KqmPHTnzbuVhHkCbbjxCH52BL0CBbi"
            "J81gcc4fyHVKUyI/lMgQkR4iN7bPonT7togbnoQfSlMWBRNlITaHWA6i/ncx6lah7pCbISGxYH3HiDHGR/hh+3Pfc+SCmAQUL4Ew5xS6ot3Iy/YISfkm+nbxFuZE4YfB27JOEpNC"
            "MpXu4nnOQFt7BdchUb5SnCNZi7U4Z8ypXi+TseRHLWIL43DOOMy7xiF2ITZzUsVzrMb99Nv23esEa5Ldk+zcA0VhPgp8Nq6zPFK4IAHdRN/1oom5hvxkf33wpFa0t6QqcN8jXsZ0"
            "TuRNJc7ZLmwMHuI6RclNhwktcgtegu+1yNtYxOAm8rY30qpKyxxaSVcIfakY/IfWLXO4BJS0hDwmh8QZloF9kTIjUm7+EtWuX2H7YlzCSv2Shoyx7Q/7wCL1fy6agRqbK5bN27sa"
            "pshv0r3ZDYP8yVTG2q4vWRWdjm/Z8E+jHfkT9WI3f31lnNUlQZLnHHFAjkOwaovX1pthhhwHvK4E2/Zr5X7JbtjidexqlNzvFC92CZvjCq+7ey05Dngdtb2SGt7VMNkVXmvL2JyO"
            "8dJVz4x24C/SDi+465Ug6XK2OCLbBV4/5ocZsl3glXBdK/c7w8urMkru7wivbFd4hey1ZLvAK6tb53hlu5Cv1QOiHfizx4vd7pUg2bFMcUSmC7wuFPUzZLrAa3eVv9zvDC+tZ5Tc"
            "7xQvWMxmusIrdK8l0wVeoXkawwRXeN3YwmZ2jJdlXdZQB/7s8dIVeCZINjxVvnnpGK85A/sYUl3gZfzVV+53hlfNjEFyv3P7tYBN7US+Ul3gFRjuZRjjCq9hJWxqx3iVP9iud+DP"
            "Hi/jQVWC5IvEDEzKxJzildQ/yODYn22D16YVHnJ/nBO8YlpC5X6neHHp7FhXeJ35k2WsC7yMoQpDpCu8aBM7tmO84KfP+zvwl2qHF/cRlSD5YWnbwS7wyhqiNjj2v2KDF/vkKSu9"
            "1jrBq6jC1xDsEq9Eeb5TvNr+YAl2gdfWi4/Yrq7wyspmgzvGizMH+TvwJ+GVK+CV1hovxSBu4giplX6FJ7GHVMpf3GOl/hLRUdwMstnul9fkfgkv25jFWPVQ7pevVOzeguV+CS+t"
            "bXd5nkXq/6uIV7YNXlzDJVZh8wuN0B634tU82W59+b8XRPnSBjx24M8sZuWbhBuFPufiqWXQfY3f4Qm33yga69hCB+XFb+rRGND6uynn52Tk5fE/wGcsy8xZyP/7SH7G64RpJjMj"
            "l2CuzszNm7tq8dKFhBNlTsbKzIVqazTf1uEi9uX/M45yz8vNmL9w8LLc1/nXbR38i9rw/laRT4pLnFIW9u7FNFEcmkR+k6ZOS0g6WPqrXpRDzl36nvzqzfKz98ziPzcUSP8sMS7Z"
            "sG7dWzvDxV+81kiqhnXpcYu3x7LFOfOWT9j2v0Z3XkA="
        ),
    ),
    "plane": Sample(
        in_the_plane, 110, 6, 11,
        (
            "eNqlV31UU0cWn/cCIYnhQ4NAag0kAcoipTSYYNVdXmggUKNG0KrnlF3ABAOLQC11d4uV8FE/0C2I9hSxalBr0bCi6Hp6zrYSsIdiTv2o0h7r6iFp7ba4fqDlWFErO+++9yCENv/s"
            "75yZO3Nn7syd39y5L9mhLysoKSoVEQghkidANHI+v0tQWGbhIsLlOi4ECkN+WAbhEieQb2+sO2jSZytishW/+8K0icpWEH3DiukGtIW4N/hL53qt9R+9vNd2TdWcT+OnbEuK9atG"
            "YsTAj5XPQItHN22UXSnMyiSpaZSCkOPWJf2WuoO6tGn3HJJVNW8/Qi8MvPL6nwNiTaq/CynEgUAzYIlDuDS6A7KSzr4bjaKJ6EpFzDxKgZcZGgp5ZWbW5bL74qoZq1BEcyL/r6Y5"
            "6wkwXukapaGHetQfdF9CuxLall/odhczOQ1q1wMY33YaxE9XwXUK5lXxYcZdGPkZ6sGndP1+O9PreQTdF9iufj3Mj4JOKmN8DzpbYUcXkcpuS/PfB4eNAK4C6eFMudp9TBhsK8yW"
            "6M61SUvIPMnuqGL+V9+/mpFbSaKYL4Ofrg04b8lITP3hycqnZPugphrledEfBsuRDP2PX85LVh8X7mhJOrzlXL9hYUmB5KWmBcFlN2eiFQNr2vt6N2V68p4Aq1jpzsOA3UPjcF2p"
            "64kN1RDZkt0hV/wcsbriAkmU2t36z1SBhjjYFYYa5hEoL/wZm2JK4kvMakMDcO5/3wJRBaRab0PnB+CCioB5D0EVBPUF0FAw7OgGVQrcQ+rX0Il4AGyPHmbW3seSvzoY7LaDsgPl"
            "43Y6S/FXcC4t4rNnnIISztmMG1U7iQNiZLbG8XTS+WKnS27kW1VRO7vP8FrFIWZXXO2mgAzpfKdLu4QfjNGgougxm1hgbs2RIKqQh9LeDLevznrLkrHIEl2NorwuIRxa7CW8FyN1"
            "9pNO1E8ip5H/jiqdv930R7kIfdLfhH5atv2LtVWGgY//5XkPcjBvxqXCHWBGcbVaaQQ2rVGhnTFSXRNeDzWJZbKCXEraE/kNua69BqU1OPvrD4QeA+7yWm3AxeXbwN5oQiQs/AQ6"
            "n0J9lxnqeiKDIeaW9oG19QYzA+oyJqDROI55XNVFaEf+DPfQUcrcQyDz9kagDgeVg1yM6xT2UtbBITXAD71jQFzS8+7qHMlctbs7RyKTyaLVbi1uJKjdbnd1Nq3BUNA9Dtpsyefv"
            "EmgYP6ubJ15bdr8aGb2uQDLOZ4TWTA4amvv9MhfuEba0lB8WpmvPJhkvKF/0JD0GfJkHz/Q5z73k2INYNd4xTp0job3IDy0sJo/j7S0fnyl4UsNEcy2TeBpGx5AKMY8eQUcI7TYg"
            "6kIvky0eVy73yAa7wIsUYIXO139KSlK6WBcIFSmTJUC3W0VG4watAGhAm7+zMMNUV2/tE/zhfDHxzTuzRb2BFRmf7E02zO2UoGr8sieyEwHbQIA2U+moTdC8DfUJPhQ2To2KVyhV"
            "CiWyTJ3N23sqE9k7L++/S3oSFQl2BbgUu59TupLJWCWFLVSkTo9MugyTH5XhqLVv3oYedtyJab5aT/IX7v+UedMnmTUsox5gWIJoqWKSAURm5HImACseMFHHZOx+0M1ggmoYOkvY"
            "Z5+NVb9nucyEL5AaHKW/Aeq4JLvL7Yn8EyJM3hy7S94p0uCx/E5RNDdFfnJ63VFnvKw1DFFH/dGeH6Mj54eQ9fHWSTSGjsUw2kwtN0/XvUr8GG9tr3EeCYyyI10PD21ZQKAVZ79r"
            "GB5nsAYx7+toF3QFdM4mWcdRudxuxa5Z/PviN7c7cbm0bKX/140BqK2ORCdHCktdSv/F51xN03Zd1OPpGtYuHZZKhJo+8ItDxqKeM75QO2gI2SO0Jbu7K2J7gjagv/RGIBuf/5l/"
            "NWpjEsAod8oQqCFYyrVFNw0Re4QHkjFNFbFVx95GiTOl6DThGSBBIJW4HBnRr76za2iImitJW01evyZDj4RSNOe/KORvfWXXmr8dvT4Uu4ZJS4NQ25nLJLnFvgtg5DWa9Le64umz"
            "0T84aBdpvfEMQtFjGzO4zyb7e/SzfH7gAzH3eWVxBEecgW1zGx1ifikgA17EeUm5hM5kBg+bXmzDHZE39oYYWLHNxluf3ZGyPghY/fd48Twvm0aW0zA88fXhpS303Y2Q4zY38MQV"
            "E4OMeMw6+R62ybk0WxvO/lzjfnhd4Y3v489+QZtZMlZhmXnoWXMobus9zrPGw4ZDqZfk+KQ55tBoGKG4cS5MJq5jc5Qi3yhgJRgP2Lo+eBNtnn8jZQMnuX2LvCThwREHyjJIFXmt"
            "P8Ef8YlJ497I9fKHOdUteJ15iaccpNe8XB/+uDb8h8r15Y/h+KRxbyzx4Y+j+4SD226Rl/w1f2xvfEst8uXPxaOTxr3xsg9/rMoOBxens9h5nAzyiE8OjtuXqVm+/CnfN2ncGzGe"
            "/nx0YCI/M2wO7g2EjiVpBnqP2B9DXQ8V6ssfW/2kcW9M9eEPurrVQZROkbK/iVN/XU4G+bhDg0IIf5O5vMLCH7/c37aYiP9nHiEsL8kvNSeuemMddHf8xl/JgaDxPGVMMyzo3tty"
            "uotNZCWsv8ZFi3Ub29cunyViueVx+qU5hqfq97eyiTmd3Xth+lJtPG9/6kVWX8ldE/1xD3z2lKi0qKSgTL/jf4/5Jl8="
        ),
    ),
}
# fmt: on


def counted(points: list[Point]) -> Counter[tuple[str, ...]]:
    """Returns points that can be compared: NaN equals itself."""
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
    """Whether a file is rejected; no other error is raised."""
    try:
        for _ in Points(data).walk():
            pass
    except (CorruptFile, Unknown):
        return True
    return False


@pytest.mark.parametrize("name", SAMPLES)
def test_each_flipped_byte_is_noticed(name: str) -> None:
    # A checksum covers each byte of a file.
    data = SAMPLES[name].file
    for at in range(0, len(data), len(data) // 500):
        changed = bytearray(data)
        changed[at] ^= 1 << at % 8
        assert refused(bytes(changed)), at


@pytest.mark.parametrize("name", SAMPLES)
def test_corruption_with_valid_checksums(name: str) -> None:
    """Corrupt bytes, one in each file, with valid checksums: an error, or the right number of
    points."""
    data = SAMPLES[name].file
    assert resealed(bytearray(data), data) == data
    errors, offsets = 0, range(0, len(data) - 16 - 36 - 24 * 4, len(data) // 250)
    for at in offsets:
        changed = bytearray(data)
        changed[at] ^= 1 << at % 7
        try:
            tree = Points(resealed(changed, data))
            assert sum(len(points) for _, points in tree.walk()) == SAMPLES[name].size
            tree.verify()
        except (CorruptFile, Unknown):
            errors += 1
    assert errors > 0.9 * len(offsets)


def test_other_contents_and_numbers_are_refused() -> None:
    data = SAMPLES["plane"].file
    at, size, _ = spans(data, Header.read(data))[b"PNTS"]
    for place, value, error in [(13, 5, Unknown), (13, 0, Unknown), (14, 9, CorruptFile), (16, 1, CorruptFile), (at, 2, Unknown), (at + size - 4, 10, Unknown)]:
        changed = bytearray(data)
        changed[place] = value
        with pytest.raises(error):
            Points(resealed(changed, data))


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
        with pytest.raises(CorruptFile):
            value_of(number, sample)


def test_predictions() -> None:
    steady = [5, 0, 0, 0, 0, 0]
    assert predicted(steady, 0, None) == steady and predicted(steady, 1, None) == [5] * 6
    # Along a line there are no residuals after the first two points.
    assert predicted([10, 3, 0, 0, 0, 0], 2, None) == [10, 13, 16, 19, 22, 25]
    assert predicted([10, 3, 0, 0, 0, 0], 2, [0, 1, 2, 4, 5, 8]) == [10, 13, 16, 22, 25, 34]
    assert predicted([8, 8, 0], 3, None) == [8, 16, 12]
    assert [rounded(f) for f in (0.5, -0.5, 2.4, NONE, 1e30, -1e30)] == [1, 0, 2, 0, (1 << 63) - 1, -(1 << 63) - 1]


def test_numbers_by_tokens() -> None:
    # One context with one token, 3, which takes no bits: -2 three times.
    table = 0 | 3 << 1 | 3 << 11 | 13 << 21
    data = struct.pack("<HII", 5, 0, 0) + table.to_bytes(5, "little") + struct.pack("<2I", 1 << 16, 1 << 16)
    assert numbers(Bytes(data), [0, 0, 0]) == [-2] * 3
    for changed in (data[:-1], data[:2] + b"\1" + data[3:], data[:-1] + b"\1", data[:14] + b"\xff" + data[15:]):
        with pytest.raises(CorruptFile):
            numbers(Bytes(changed), [0, 0, 0])
    with pytest.raises(CorruptFile):
        numbers(Bytes(data), [0, 1, 0])


def test_codes_of_points() -> None:
    tree = Points(SAMPLES["plane"].file)
    corner = tree.corner
    assert tree.code(corner) == Code(tree.deepest, (0, 0)).code
    with pytest.raises(CorruptFile):
        tree.code((corner[0] - 1, corner[1], 0))


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", __file__]))
