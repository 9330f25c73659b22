"""ActorsNeRF's published frame lists, as the released code has them.

Ranges are positions in a sequence's list of frames; AIST++ few-shot lists are video-frame numbers,
and so are all support frames. `protocols` turns them into frame numbers.

Source: released code (dataset_args, finetune_300frame, eval, prepare_AIST_zju_format).
"""

ZJU_PRETRAINING = {
    "313": slice(0, 550),
    "315": slice(0, 550),
    "377": slice(0, 550),
    "386": slice(0, 550),
    "390": slice(600, 1150),
    "392": slice(0, 550),
    "396": slice(0, 550),
}
"""Positions; for 396 they count from frame 810 (see `zju_protocol`)."""
ZJU_396_FIRST = 810
"""First frame of 396 that has an SMPL fit."""
FEWSHOT_SKIPS = {10: 30, 30: 10, 100: 3, 300: 1}
"""M: every how-many-th frame."""
ZJU_SUPPORT = {
    "387": {
        5: (75, 225, 300),
        10: (90, 240, 300),
        30: (80, 230, 300),
        100: (75, 225, 300),
        300: (75, 225, 300),
    },
    "393": {
        5: (75, 150, 300),
        10: (90, 150, 300),
        30: (80, 150, 300),
        100: (75, 150, 300),
        300: (75, 150, 300),
    },
    "394": {
        5: (0, 150, 300),
        10: (30, 150, 300),
        30: (10, 150, 300),
        100: (3, 150, 300),
        300: (1, 150, 300),
    },
}

AIST_FIRST, AIST_STEP = 200, 4
"""Video frames 200, 204, 208, … are used."""
AIST_PRETRAINING = slice(0, 500)
AIST_POOL = slice(0, 300)
AIST_EVALUATION = slice(300, -1, 10)
AIST_FIVE_SHOT = {
    "d16": (200, 564, 824, 832, 840),
    "d17": (200, 564, 1228, 1240, 1252),
    "d18": (200, 500, 708, 736, 780),
    "d19": (212, 280, 408, 556, 564),
    "d20": (200, 240, 644, 700, 712),
}
AIST_EXTRA = {
    "d16": (204, 832, 844),
    "d17": (564, 1228, 1252),
    "d18": (200, 708, 736),
    "d19": (212, 408, 556),
    "d20": (204, 700, 712),
}
AIST_SUPPORT = {
    "d16": (200, 832, 840),
    "d17": (564, 1228, 1252),
    "d18": (200, 708, 736),
    "d19": (212, 408, 556),
    "d20": (200, 700, 712),
}
AIST_SEQUENCES: dict[str, str] = {
    "d01": "gJS_sFM_cAll_d01_mJS5_ch06",
    "d02": "gJS_sFM_cAll_d02_mJS3_ch04",
    "d03": "gJS_sFM_cAll_d03_mJS5_ch13",
    "d04": "gBR_sFM_cAll_d04_mBR0_ch01",
    "d05": "gBR_sFM_cAll_d05_mBR1_ch08",
    "d06": "gBR_sFM_cAll_d06_mBR2_ch16",
    "d07": "gJB_sFM_cAll_d07_mJB2_ch03",
    "d08": "gJB_sFM_cAll_d08_mJB2_ch10",
    "d09": "gJB_sFM_cAll_d09_mJB1_ch21",
    "d10": "gPO_sFM_cAll_d10_mPO3_ch07",
    "d11": "gPO_sFM_cAll_d11_mPO2_ch10",
    "d12": "gPO_sFM_cAll_d12_mPO1_ch16",
    "d13": "gLO_sFM_cAll_d13_mLO0_ch01",
    "d14": "gLO_sFM_cAll_d14_mLO2_ch10",
    "d15": "gLO_sFM_cAll_d15_mLO0_ch15",
    "d16": "gLH_sFM_cAll_d16_mLH2_ch03",
    "d17": "gLH_sFM_cAll_d17_mLH1_ch09",
    "d18": "gLH_sFM_cAll_d18_mLH1_ch16",
    "d19": "gHO_sFM_cAll_d19_mHO4_ch05",
    "d20": "gHO_sFM_cAll_d20_mHO3_ch11",
    "d21": "gHO_sFM_cAll_d21_mHO3_ch18",
    "d22": "gMH_sFM_cAll_d22_mMH2_ch03",
    "d23": "gMH_sFM_cAll_d23_mMH4_ch12",
    "d24": "gMH_sFM_cAll_d24_mMH1_ch16",
    "d25": "gWA_sFM_cAll_d25_mWA2_ch03",
    "d26": "gWA_sFM_cAll_d26_mWA1_ch09",
    "d27": "gWA_sFM_cAll_d27_mWA4_ch19",
    "d28": "gKR_sFM_cAll_d28_mKR4_ch05",
    "d29": "gKR_sFM_cAll_d29_mKR3_ch11",
    "d30": "gKR_sFM_cAll_d30_mKR5_ch20",
}
"""The 30 sequences of the paper, by dancer; d16 to d20 are held out."""
