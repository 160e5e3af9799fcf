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
    "eNqlWAtcFNUa/87M7rAuy7ouSIikRIaAvyuIcH2lrIogimgZJGXKI0wNEUWqn49EJUDygaBeVEQQRAVUREVTQ9AMRAysLBN+RWlKCkWC8lDbe87MGXZ2b8i9v/sNZ87Mme873/97zixpvkvD"
    "IhdFKREAMDIrILRp4SM1KIABgWT2cddkRbtRzFscyBZyMOud+JFgCSyRwEORAiPAzlfzBdix0aqyEZ3LVWfMFrPTirTBPzhYhvb/OJmBWBiGOcvwQEnR49YlPpfM/Nw6VqCyIb+j6K1+/nnm"
    "81JtLu+A84fmN/z8fMp+KJeNgCSkqx4xq8LuxMB75kPCtqBxd21KixiwdVfChPKw8WVM+9BVpz3S01a39Q0ID0o6vMrX4YGPY7X+MGfz8Q+NP31oFeKdM+eTVz1CJqUkL9w5KK9hdGauzMxq"
    "syy2tNMyZteVW/cc3uDWbyx6emLbJ+Eh2qL2ucg2ekPC3tqa+i+CJ2uyXlJ4NCR8fNfxq93upZVh9992Bc8Gbr5OXz0jwzNi9bbLVjNGKz1k6waunugVw0bVFll6NN2hzMmOdq9UNmjqG8wX"
    "Kpj2Orzf7C9fCPa/Hp+TFTq0VhO/Z/T7VR0OnzrvjrbCDF0/qBr3fbbxRN6mmZMssNrGmrkIL+O9nyyJ+qXQ+bZ5Vrb+c92lgFqBy7U4fX8f32w0Cu80MHoyEWkbOWrZdxAFDjgyqSQ6WW7l"
    "pl72OF5iGqFvMltabg2Cflt7iWRi4qt3bZLC7begORtAE1M9YqqPe+q2DNepExy3bh3DWbWoIHzBYO7ujIrvO2PnHT2GQlPK33xtXl75k5zHpc+K2+32X61IfiVg0K4O51s7N6yJb77wpg+T"
    "MXfNn6VFD1ZXnRtleXa5p8WzZy9MXTI/6NG7LZMLFnvM6f/X8fyhdQcCPy8JirCYcyPNLzTw+vbA6wswQ1tUYGtd/pYZ+JKpzXdJCCz/R+H9K7+MCYrNCfrVuyR/6Di3t3Y4Fyz+Ga/e9C5w"
    "eLVgpS3m/XN/4EZUkDy7YGXxyor8OPeC3dX5mU3Tg3ckRgZOey9w5mOfI/lXQwOdyvIzI9WF94+VuGyIDJzJgRxEkmmySH0JA90zq5RfQ7uZTFQum7sTpbFlbJH8PLNH/gidYDdxnbJ18jZ5"
    "HXuEuS2/gypllcweGZreKXeedIqtZR/Ki9hH7IuH0S6zTxnjIkWkwPRPNPgOjw4A9pkek5fsP4mF30vqmkvqjlTHocrc1Cu5qYcVp8hC807ETyV71AJHs42wXuIo3Jao9AL1qRf4XjktrFvH"
    "CWSRR7a7cgdtI1PuQzk/pf5mz09X4h2EfTebVfALfsJu+xQHhMfjsE3d5KZ7j1k2EqX+qynItfTHIKRAuEdxzxsI1GoO5aFGdAddRHfxUdV9l8CWMlXoa3Y9k8eAku9fPM0KQVC3C0qCO/Wu"
    "2jX7WRjXMca56Q9J/GxCpPHjsLDodrAP8WRv7oIPHM1OPqxu9htx7cjwxx6I4zhUgkLO4lMYOb17FiGMTqEC4zNIzuIKCyqeWOrQxrX0wlH0sDCVKeg9ZzxnsYgjfmKAYfBAanvOxAWPkfdF"
    "5L1Ch8HN0dWj++gmPs6iLuobpMZWMkj/TSighNsKYjZ+9l0y4h/gVFPh/GLwIFrIO4A/yJPCjdyFQg7+GA4N3zNwYQJhr9mEihO5g5cQ7G1m4PR2BOucyXobmzW4ZTjgv7IJIGqALmE2OSFb"
    "UAOoQIXPSsS/pdRYp4oh2tV8MBAjmExuMCr+SsagskIu7nc51PSFfTtZKLrHwE9XuZRKBvYNrl/PwtbLLJA7LI+x/1ojI3Dh5AUEeS9CYTraM40sPNorh9xlcKiM4R8jqO2L4debZw0m2Msm"
    "4LmN5a8A+AfdwDvxIbVFNNLIula2lUUKNVhbq4mZarDCpiqtwEqN3IQkE1zNCPEE4lhMJDwtKUoeEqaqLRgZRkD0f2FZOHD7yxiWAUWnAQsClbVWq1XjaGoNtQbu3UoYqqk2gaW6KKGkBHNR"
    "H09trInOpy533KvHnpyUMQ37yFS7KQ41aK0wDo1GqyJgGP41NEiiDgeRYxgJKh5SXDuDMwxuH2ZxFLt5WxItsEs6MbZf+kgxIgykZbiAkA+UKVQxEiQMrWwPkDFWsMJgQY3PPGLcBoD/AlLx"
    "OUgDRV0o5B+jFGG3pPUhOQh8suEM5OeaBLbOXJDbWsmgrtsi7nOLoKuDgdZ2FtbnMAXp1JY95+SIZh6xQEg4XD9g7HgwZFW3QYaT5IlwkEBoVdbYMJJ9+LuPN0+tUiAl2INxMCTpgVKy+wom"
    "dTNsyWDht3zGKEEIYPjb/JBg6vx7h9sSVFrsao1ag/z5ntRwUAtopz+fdIaeZIuBagSAIADDeUG6T36DHKrHQs1GBn/ZDJY2GklvIV0Fb2KHNyFNjdqqZkR7eaVYOq4LEYN5m9GdPBn8dQ3H"
    "8lsWigdQk4kOYiK2WRInQzgMSnklOGm0uNhV1tagRSo3/NIgqnAvOJmvOD4AtbFtLAJ8Cwqk6n7dCAgxQE4sU/6SBylmkx5XATb/iQtmxHsZAtIYj/gIXUpBQmiMwyKkkxQ11WrcqzAkK6U1"
    "iYxag12nxGWBxKo1dCoSiqKj/ek63zdzqyy6sTw5iIS3gAFCd7+SpqcQI2uVjZUGsEIQNCEtn4Nx56z5u6ZiC34Wcyv+dckeSIHzRyWaYimULdjhEVPnmcG/yK+26i/ZUA58/WCccC0TVpxc"
    "qcwGPBago10qMCb7qwBBF0EiE+dUTGUe4NF0anR/4ohZlwAGjhXWdTsRdPYV9NAPDee9ZsJFCPFPWHpeH7p/xUSBb7ENwPYkqYy98zMqsxmPz544HyOd6FAowP65At/oCtwf4qUyIc7J9BPr"
    "GEF6+nRsPyrTkS3wKWoAQmukPohzHkPB/IxHftInjaI9Q9oM9vxYY2SPi63SgK1z7IPhBNvURgTp1Actfgy4JoPUHpeDSkN8Hr245wZD+cwthfWUYAZG/lMqo3O5RGWm4DHno/OrOKqn/xma"
    "9u0IzC2MfOCioLWyFo9+wW7hKqrHc6OwPvocA8FgZM+wRCpDUnBheNtTEZsvK/Ddn8bAbqVRfIYdoDLZeJw9eGGthsqIe0cnMfA4wAjbMB+aYIvx6LvooRcxL72AgTPrBb6yrxg4e8MoPsOK"
    "qMxosv+64zVyyvftQYHv4ksslBQio7zNobMTnZdPhcuZdht0pAZEHiIn6hKlme5XgpQcdD3VEV2xz6acQ6X6vl2vk+4i1Uf1OP2vcvTL3mkefTaAzkfGf/+lHn1oJCfNW7HexfqmJQxrrlfG"
    "LF7mr+ut5sVmJ9bt+5rmzCkH3tT1VPdUn7Pof1rKsMDLO3OezXydtPalNSn2iz4m8YjpmPT57L4TdL31DLWJ3F2/rpc//c1X11vf6Ef5xV9OR840jUnyEuSe1zv6m/hzyATf3AP9BL/8Xf+g"
    "+7tMpvwi3iV5ryesCliiI7Ut9gNp3Kk/XRwoP20L0Owj2wxOIUZypL6NewK4mPrlyZXOodM7p+h661mm9VCkRy36Mmddb32LM/Fna6ym/kKITtdb7xLzk9oLt97mPE7fmKzrqX9RvmF2INUP"
    "sOOPA6eSu97QSfuRtLeIfY8xzZe9XiNnzrrt1Vvv05jYV3X0vHyU3XRdb/1PaaKvNjz+tbEvjNf11gPlJnHIH1/XWujnqeutD9qI8cYb3F9S6u0EPRNyyhnw9PCfX88Im+VlOvck81S/iKiw"
    "Qpz8w4VLIyOAi4pdEhaxHMlWRHy0gpGvWB67YiErWxyzNEpmFhPxQcTy0Eg5hdjiBf8V/T98SLnAffh7EUsJAP4+rYd/CpdbGxLIf5L/dMdE/fFGmo0qGmX/gJneFw7NL2+jvw0UNCr+PlMm"
    "ruz3oOapsB14UOX+fgGzqwNvRrnRLrGIrs+Y8sZEZm1H8S66vpquZ+Bxs/GddGXUosiwpb5p/wZwkZM8"
))
SPACE = zlib.decompress(base64.b64decode(
    "eNqlWQsgVVn3X/uc+3K7rtN1RyrlTozSC00a6eFqVEymzPh6mWZGqqlMKWF6FyJ6qaiofDFpFBF9RXpMETPoNXqYTBpJJmpSlEHD5L/3eXDd+ff5/79vn/Z57LPX2mv91lq/fa5iJi/zWbLY"
    "T44AgBYZA2mSJ8F5IAMKuCbSBF8XZR5AAV4SEC2SgMfnYe+DMdD4FZki2wV2YDaZKQAzerki1+71CkWO1Jf+KFM1+5cBxnPf2bCVgtEwGM9kyCKMz7iQCOk022OBeZbwHEWbxsimbLWc5P8e"
    "eNf2WrVqVeY65KwQ+TABijt2hUMNvqYsfaLQmMemCxNd6f6hgyCxZ8SU9tU9fI+NmFZk9zxwk+tXq37/wujLhqiq4T7qGM3v/6wrNyszWB/mY7Z96Q2r9PzH16qmPrkxNGhKj4yQf9VZxZbJ"
    "Xs/+fvbBuRZb568LD9mQu0npVxM5b1SoQ66akQ6EBqPJZp7HQrZpb4K/x0hGGkcJI7vMsye+aKm2OWWgnZCnzhymeRNhEWV9J3dikVH54ZXrVCF5cQiL2IqX9Kgyj3JIhuRgBweEdWp1xC2p"
    "TXZJiwYmSTxzs4MdBvWJ+/PTyHly++U9X+Zn1/ZLcPG2/UqjnAqRmw6/+7/o1rxx9ta2ddgzarjrII1yq6Rgo0NV3A6ijjwlX1RXxU0wnBPWljks2CGy/a5J5CZjaCAmedC93nVasq2iwU0k"
    "mSfxD7bWmqkN/d2Re0gYVZW4SPPmIWcMjIB+OFT2JF6DBuRVPnS+68fUGRgl1aHEKlMcpJJ5USEOkuq4cTKquFDT2+516HxL8xib1etw/CfaWopsCvtBQLbcz9ff8fNhJ+fkeRnNWnmvwMz3"
    "09++6qvYv+2fQe99F7VnuJ9Pxjct8zY01O18sl29ptzJ9HAvp5gda9ILzvqaO2V6MjWpwyTO8cclra7xx5saxrTV5xtdWoNH11t8GH/8x/Bgh5l1jyaf6lmTel373o3pH8rcybS+49e11D/M"
    "jzAyH2928hCeUu/of+LeK2+i9NLDfGstVrB0LRYKKXbuUOsknGomWN6YvtbOuCbVLm3a314P/GJLQGmLJda3YlLVnKydD/iFyIoOZaqa1G+HEvPC8N36ts3sizm98MJ3NuFTwCDWhOtb8SW4"
    "LTKgNMocKyp8wevfOA1Lnbzz7o3pFpN15MkKG4k96eMnYCh6u/BGfUhh4UsTsa6x57BR4zeAM9jicAXgmHkEUza7Zh42ldjUWCiaIafQ8nK2ibtVw+vEJxSoXTdHREjHSAY0a1cYab58+Ztp"
    "geaxKVha9C52vVG1brTErhAOldzfU/FcBLmX4oPuH0poDJ/K/LR4Xl7c1TFT1+cWPq1puhAY+53b8+9eBVtmBXzzg5I6N34yJZa7q00uPXsdFi2xGmu5rLZQMtJ/YfnXjyYf6rHCKNzl6bkD"
    "e0c7v5h087z1jMJZKRNOmq4z7r/pjO+yQSMmbisy8LJPupJx2jfCNT5xOu3JTDbURC0d7bbaKf3e0Yei9APqDc9++HRYqHXyKO/HMeodf2hUOavPldcOvzD9tu2crBk73n/612lfm98GzGs6"
    "12TnNy0m/4PMql+X5pdlVrQuLt335vOsGYYh/qEzDN3PFsXVlf310XETdd1ML3vGaFmpxikyScIUZi/vSdG+laKSMQcMNf21gaVeWfNQxbTjM7YElXrZ60+pcwz/cnHpvZg1TukHgq7UzzB8"
    "GbDbbu3nrbVF8+knfWc1PM+eu33dhzK/T4dFXW4ekt4n7uUGr6zYFfwcEZP/mf2jmS+OTj+e3YTfutuVbsea+qRFNN9O/eT2Tt9PUn9YmfkJHTnvsxxZCPrghSjd6zffS7dSV29rJNOxE9+f"
    "WB843z1KQ6evWnnQ6zLGbwhx1aPl8mf2RUZVx07GqCtS8/ZgfW7tjs7HJclxA5zGu90EEIPQREwiKXCuoxppkfg6OkAdQnmiOftQDJ1LZ4ovUAfFf6BT9HbJa1GIuFFcTqdTj8TVqEhURB0U"
    "oSmvxdYTsugS+qU4k/6D7peC9ku3UV23DgS5AO2tDKF+gBa8y/zVjpuT6O+NhufZ5XXZ5enXglHRkejiI9EpsiwyULcPsZfsg0puRp0pN55txT1mK9q5ZnCfm/feGW7cJJhrhslEXXE12k0u"
    "R16K2Uv0Ew17KQ4bwOndIS1kB9w4bQmy77jXY7BPHc1Wu5Dyfx9Fxz6bYXOxYgaSIaBEkn/XESiVEpSMalE1uowe4+NKx9Nm+iJ1Bd2iQ6lkCuTsrso2D28E5fshe/brdhvV+sM0jGkZbf3s"
    "hU78TL114yfBwgLsoPG2p8v2wzdW0tMvr9W52V1PH940EkkkEpSNvM/hkw85zT+HELZOpoCuZ9A5CyM0KNhG84DWbuRvrASEuUuujH+WdL0m0khCcKKAonBHSo1ED4Im5HIZuQRqsXGztPfR"
    "U1SGj3PoTx4bpMReUqi9sEQK6ELFTEBV1fbEeVRgfP+pHD00SM8SIwaPMKDCHQNCkQNBxEDIresD7fUi/PLYhWFwProfxByg8VNi8yjIO9wLsu6LAUUOrLxDQ3CDiAWU1dp5QtccT2SJ8RIV"
    "CVJ85laTgxIUeCkV9Odwx/cMRbzknKyNtoKjeEGyNG6s6W33lkLMNhkkvJGTserdPQBVnKAgqtUQMp6SYMKvIT0BlaXTta00sSZyYFzQsXyUs5sqekDl5lCA8o3zjVmryA13cEYmR4kvbpJw"
    "Jp5w+fEs0dyUREftF725QrMWM6BQqVUqBpQINIBYgFgM25qx8Yc2T/3rvAx7T5BAHb4Tbazz2GMF9hZYhFg3UeLl/rx/qOSCH+8Wiix14b1BXV1AXexGfzMVMUoTuVKFAP/DJiaeskCAIUNw"
    "vRIhwABgBVgOG9rQ5EaiT4FWyHoEAva8XQnxCC7l8FWBKm+EIthWLRWgJ7Zdc4SfIyjI5IDHI4lYhGDcBXQuFqgzGzpxZ724UUkg4iDuCjsOSN52V+wKo5SrVWoMPxINIMADm5u5YeMqt5ix"
    "NqLG4rEJlWqIaVMAevztuISbvSEV79cIW0MMIjBiC3QyEq/HLcmBSBIfQ0ZykihXCmygJFBSXOlxVzlJTuzq1TgMT4U5C1Nwcj948KcGEvGyAMFVBgBHD31AHtH2/RqIqevJwrYnVwM7vzWC"
    "q6eGss87pwKpr+DYASi1wAH23rViU6eprC8U1ljDz7fHwq5LYmje6wTQXCyCzBPvsBCTTiAWPAP2CYPcUiyKjBOzQ3p46xWkXuoXCFHgzmwUdNFhC5YdxQXyc4vkeZ1UeIFJgwETE3I2VZgw"
    "ckaJgUQiDj4F3sRwdVMER8Snl5oSoMQhDP7eiYSQYAhwpnUEAFsR+wawUOLIHn3SH1DOr2MzE/rwmVdSi7U++EEG5QkW8KqEIcMtlVaAqp9pI3bbsQgCnP8VY/AAqz7x/VAoTTcnSVqUp4BO"
    "8Lj85BCLeywW2ItLXzKpo4IjBnJHF8CEE3QUOYfdrqlYMVaCs54DavMjmS73cbBec+RmE0oxMVEpKUZB8o8BNU5CR/JbjxQhSTHMDujCNjcov6ZG0dvwj742CukEmKzNKeYIXI7wb0WEcxTl"
    "1uwnFR5cYEwK8xdc56ijJJFAIEKlIbmKQTKWDPh0R8Fb1gjUdC1tFsSm9mYDgA7UjIVrx8VsZqLO7NPJN4IV0kkcFhIuT1RoMGJQ7cFEhE5vMUahP3xEqBqbg34JwYSEzECpFmoPG2JKCaSE"
    "cnecQXD3kCy3wpxUHUkPLmtQ7aYh8OhHi8j7pjWNNnCh0Uqg0bQqFWDo7ydYHL/dC261q/jcIOEBHHI23l3TQSDYriEmMlzccDA7IslF8JpjdQZqO0LtOUBjopIBXw5qpGCdGMASChsRdleT"
    "sfRamZLDUWYitvTubQ07JfKYJztWVvAevKoZwY5hhiWt9QgFxcW92CE9XsUJzLrThW95Pu6SvTgmnJlpO0UFYeL7r8WNzyWcVx0ZW3+YVANJBqWSwcmoVMmVaDyOS+VPpQgdqR+MLv6kJRSE"
    "OMZAcqTAXyYkNsR8FF/pjj8EELGbvMKfUoRWcSDZzwkRF8TYIBI4kloP7tCs1zheuzLlkJTWi9wSLYCNLNoxGW6lifhtJS6IRIsEEC+gU3m8j+hkhvute64HK92/rZ+Eb27ec8XnF3kfI5DL"
    "8cedXI7UxJaO1r/LhsfyEtlQBLs65p3ZOhxQZjX+Eo/FGdOx+eFGtj1UtKcvnMoW6Sj+PWwSVxecrX/bCDsYh7vRqxv9Q3efZ2tch1+4aCXukOSESkuapbXPZBzjIEIlarWKUeA4KuQUg/rr"
    "2Cd8e/CNDW2X17WPI1AXRwHF71Gx9a6j49+6duy0BL3VJRysTlp4myd4D0WmYKJksBdk+5cLX+cp/G+JQbhbrw4dyo4/D28/1CyHxQYS9n74TAXYnZUAFxZXKpb3xRp3t0XpuRR0bacLMA+c"
    "N4SdeQb8LwQ36ia/TgDuqivRo6R6MiVLRHBEKYXr+6W8zBTKxYB7l427i9wvogc/98fdCsiYAqDOEEPRdCPwfCLiZT6m/uRlHHBfoPjAXsi8Kmz8aLEMbINwruLNrNO2adQI3p8FuEdFPGrA"
    "XsOuEpr1wWWvjLUtZ7gRLNpiwGMwi8rlZU7iHviP2tc9eJlMTwbiHDnbrvRWwdlxggwwI4yEWgHIP3k6lORJo0QNqz6n4I4tgPcKNXj5UOD8iWAbMP6801/ifjbbPZGMa76Vwq1LIvgIV3O9"
    "oQLmxEphRF8ZL4OYEl4Gf+pBTOANGzW+104wAuVECjwx8HesTcBnlww8TAQZijE15GTGYRnPeZ4jyR9fiQ9E98I7wK5zTGqksw7NTFdyMuNxT16bH06wLlEZg/aFFJyXiYDJMAa/UDnk+Ip5"
    "GTETw8sQIjZM+Xkskakcbcz6TewheIC/LgZS5rqyMz7hWdZvJLw/h4casPkSXGEE2b4KOJov47GWMf16cjI7cd/78pk3ST/vRybwo0bOYpC4sRfEv2MIV88I68gYDz4+V3FfJn1nO9lyCFZ+"
    "FwHe9KPA1qMvpHnJQOIuYCBn+vIkWIx7ho/pKQKjZZ0JvHxhwK7DUH0hdw0DRkdpXkbBVDOdeZB2ZvM5kgf1p/qAao4YHhhjS8v7QKO3WGcdJUPx/vQl5WkYH4J4f0S++Bs7zoBdk9yfThby"
    "jWHSeJlWgt1as1sMH1PT3lyOZuLkSuuvghutAm6mzFEVv9fhPsRX89yQt801ioFJexHs+cQcXGarwHGhQUftJkEnh5C26+YXX75+Eqsl3CHMEeRI3Qn8OJi/CnV9cXjK3cG3VnaRE+qIyAk8"
    "Q3WyJpezr+Q7H5tbat/GW/x8SrBPoGLLu7ZJQ+xWanV5SHc9jju0/285gSf78e+EP9e88e8xxfzR8r/JEQ7T5UqBG4Vt8HRZWrr18ona7vhSwFHgvOg+E1s2h3+k7Y4zaT1cA1d8k9z8/mht"
    "d7wp0YvD2fMbzX6JcNB2x5099Nbbv2evt53DbO3b+JPXz6zm55vz14fhgSl+f+zWkrmkRkm9CXlG6pr6D+Xo/1BO4PnR/Hxj/hp+LOyMeP1KVk6Xgwmf6nK9WC9+4pC6FDBy1nbH92p+vpA3"
    "+/puiO7v7aXtjvON9eQ+vTJ3cUb8Z9rueF8/X2bcrl3ujcZou+N+Wi9fzo2uqH3jbKHtjv8leut9HfnLr9vHjtN2twdY8PMFpjpNByQNHblJK3A6wYVwOuFn3X1AIeDPX5mvVsZPa/fQdrcX"
    "GOrFb5+9jan9cndtd/sB0sOldWST5pZJm1N3e4K+XOPsuS5Dyu47dbcvMHp2Jmaatr9ynantbm8w1Fsvty7s0JpVHtru9gdT/robu+GXsvDqIHh7Q4OSeg/70Oz3qlF9nPSvb5Npa7doJMsg"
    "iXjlomVLFoDEL2ipz4IVSBS4YFUgJQ5cERS4iBb5BizzE0kDFnyzYMXcJWLeiXon+D+1/2Yekn/1/vCFC5YRA9jnmLf8P/ce887Ec5/gPmUtlfn113yVuvDs4j51mktJj/kmGb34v67z1eE+"
    "aaJzyogU+U/8rjOSX9zdbapn3T2LOzT/o2UxP/7xxH84uwxuf7yEH1/Hj8fjfnD6Ylu53+IlPssmx/wPyqD3Tg=="
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
    for place, value, error in [(13, 3, Unknown), (12, 3, CorruptFile), (14, 2, CorruptFile), (16, 1, CorruptFile), (at, 2, Unknown), (at + size - 1, 6, Unknown)]:
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
