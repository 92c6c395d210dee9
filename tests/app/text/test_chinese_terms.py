"""One Chinese term a thing: those on the left were in use beside the one on the right."""

from __future__ import annotations

import re

import pytest

from app.ipc.states import Event
from app.text.catalogue import tr, use_language
from tests.support.catalogues import entries

INSTEAD = {
    r"(?<!中心) \(\{": "（{",
    "(?<!限值)守卫": "限值守卫",
    ".指令|指令.": "命令",
    "Escape": "Esc",
    "STOP(?! ■)": "停止",
    "(?<!断开)失能": "断开使能",
    "(?<!步态)周期": "节拍",
    "假名|标识符": "代号",
    "参考线段|掌骨段": "掌部参考段",
    "包络": "凸包",
    "姿态": "姿势",
    "审查|评论": "审阅、批注",
    "按压|推手": "按下、推按",
    "控制(?!进程)(无应答|没有应答|已停止|已结束|可能)": "控制进程",
    "手势集": "手势表",
    "操作者": "操作员",
    "效应": "效果",
    "校准": "标定",
    "模拟(?!两台)": "仿真",
    "没有回答": "无应答",
    "用手$": "发令手",
    "疗程": "训练量",
    "监护|防护": "守护进程、限值守卫",
    "硬接线": "急停",
    "确认(患者|穿戴者)": "核对",
    "网络相机": "USB 相机",
    "资料": "档案",
    "路程": "行走距离",
    "迟到|漏掉|错过": "延迟、丢失",
    "释放(?!磁盘|空间|或修复)": "松开",
    "(?<!缓慢)变软": "阻尼",
}


def test_one_thing_has_one_name() -> None:
    texts = {key: "".join(forms) for key, forms in entries("zh").items()}
    found = {key: old for key, text in texts.items() for old in INSTEAD if re.search(old, text)}
    assert found == {}


@pytest.mark.parametrize(("language", "text"), [("en", "lost power (left knee). "), ("zh", "失电（左膝）：请")])
def test_brackets_are_of_the_language(language: str, text: str) -> None:
    use_language(language)
    joint = {"en": "left knee", "zh": "左膝"}[language]
    assert text in tr(Event.DRIVES_POWER_LOST, detail=joint)
    assert tr(Event.DRIVES_POWER_LOST, detail="")[-1] in ".。"
    assert not {"(", "（"} & set(tr(Event.DRIVES_POWER_LOST, detail=""))
