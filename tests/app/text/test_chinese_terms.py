"""One Chinese term a thing: those on the left were in use beside the one on the right."""

from __future__ import annotations

import re

from tests.support.catalogues import entries

INSTEAD = {
    "(?<!断开)失能": "断开使能",
    "(?<!步态)周期": "节拍",
    "假名|标识符": "代号",
    "参考线段|掌骨段": "掌部参考段",
    "审查员|评论": "审阅者、批注",
    "手势集": "手势表",
    "操作者": "操作员",
    "效应": "效果",
    "校准": "标定",
    "模拟(?!两台)": "仿真",
    "疗程": "训练量",
    "监护|防护": "守护进程、守卫",
    "网络相机": "USB 相机",
    "资料": "档案",
    "释放(?!磁盘|空间|或修复)": "松开",
    "(?<!缓慢)变软": "阻尼",
}


def test_one_thing_has_one_name() -> None:
    texts = {key: "".join(forms) for key, forms in entries("zh").items()}
    found = {key: old for key, text in texts.items() for old in INSTEAD if re.search(old, text)}
    assert found == {}
