"""Reference rows of `reproduce mechanical`: id, value, tolerance, the paper's number.

The numbers come from an independent implementation, written from the paper alone. A tolerance is in
the unit of the value, or in %; it is never narrower than half a unit of the last digit printed.

A single row of `TABLE` is ``id: quantity; value; tolerance; value in the paper``. A grid of rows
has a line above it, ``id = columns``, with * for the name of a line and # for that of a column. A
column may give a default tolerance for the rows below it. `WORDS` describes the grids by family.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from sim_pkg.reproduce.contract import ABSOLUTE, EXACT, PERCENT, Reference

NONE = '-'  # an empty cell of a grid
WORDS = {  # {rest} is the id after the family
    'B1': '5.1, true motion, sample and quantity {rest}',
    'B2': '5.1 without noise, error of dq1 at 0.2 s, {rest}',
    'B3': '5.1 without noise, 5 % settling time of the error of dq1 [s], {rest}',
    'B4': '5.1, mean of 20 seeds, {rest}',
    'C1': '5.2, true position at 24.999 s, joint {rest}',
    'C2': '5.2, rms of the true velocity from 10 to 25 s x 1e2, joint {rest}',
    'C3': '5.2, median of 20 seeds, 25 s without the first 10 s, {rest}',
    'D1': '6.2, nominal plant, sample and position {rest}',
    'D3': '6.2, mean of 12 encoder offsets, {rest}',
    'D4': '6.2, nominal, low precision at 112 Hz, GESO as printed, exact step, mean of 3, {rest}',
    'E1': '6.3, runs of 4 in which the pendulum fell, {rest}',
    'E2': '6.3, mean |q1| x 1e2, {rest}',
    'E3': '6.3, mean q1^2 x 1e4, {rest}',
    'F1': 'velocity error of central differences, rms, {rest}',
    'F2': 'velocity error of the cubic smoothing spline at residual q^2/12, rms, {rest}',
    'F3': 'velocity error of the white-jerk smoother, most likely density, rms, {rest}',
    'F4': 'standard deviation that it predicts itself, rms, {rest}',
    'G': 'one joint, best rms velocity error over the bandwidths [rad/s], {rest}',
    'H1': 'leg, GESO as fast as HGO, median MSE of 6 seeds x 1e4; noise variance, joint {rest}',
    'H2': 'fast pendulum without noise (b = 0.9, 0.1 ms), rms error of 4 to 6 s, {rest}',
    'H3': '6.2, mismatch plant, {rest}',
    'H4': '6.2, nominal, low precision, chirp of 1.25 A, {rest}',
}

TABLE = """
A1: cart-pend: max|Psi Psi^T M - I|; 3.33067e-16; 1e-12
A2: leg: PLvCC residual (central diff h=1e-6); 3.14946e-10; 1e-08
A3: leg: max|printed calM - M^-1 Psi^-T|; 2.22045e-16; 1e-12
A4: leg: (calM Gam calM^T)[q2,q2] at q=(2.2,1.8); 0.000559902; 0.1 %
A5: leg: slowest GESO error pole, 1/s; -0.000169787; 1 %
A6: sec6: K1=Gam1*Psi11^2, hanging (cos^2=1); 10305.8; 0.0001 %
A7: sec6: GESO pend. Euler spectral radius @224 Hz; 0.991049; 0.0001 %
A8: sec6: GESO pend. Euler spectral radius @112 Hz; 1.17267; 0.0001 %
A9: EHGO Euler spectral radius eps=0.009 @224 Hz; 0.984127; 0.0001 %
A10: EHGO Euler spectral radius eps=0.0126 @112 Hz; 1.83447; 0.0001 %
A11: EHGO Euler spectral radius eps=0.025 @112 Hz; 0.877729; 0.0001 %
A12: LQR as printed (u in N): max Re eig; 30.7614; 0.0001 %
A13: LQR sign flipped (u in N): max Re eig; -1.86543; 0.0001 %
A14: Remark 5 counterexample: max Re eig, injection Gam calM^T; 0.230583; 0.0001 %
A15: same, injection Gam calM^T P0; -0.104758; 0.0001 %

B1.*.# = q1; 1e-06 | q2; 1e-06 | dq1; 1e-06 | dq2; 1e-06
1000 = 2.26235 | 0.278928 | 1.35655 | 0.444458
14999 = 1.41963 | 5.26799 | -0.506115 | 0.365568

B2.GESO; -0.141895; 0.02 %
B2.HGO; -0.00455508; 0.02 %
B2.HGOprinted; -0.386821; 0.02 %
B2.HGO@10,70; -0.139369; 0.02 %
B3.GESO; 0.629; 3 %
B3.SMO; 0.212; 10 %
B3.HGO; 0.145; 3 %
B3.HGOprinted; 3.676; 3 %
B3.HGO@10,70; 0.629; 3 %
B3.HGOsub10; 0.149; 3 %

B4.*.# = ME1e2 | MSE1e4 | ME2e2 | MSE2e4
GESO = 0.494063; 0.0413; 0.5 | 0.380245; 0.058; 0.3 | 0.408672; 0.027; 0.4 | 0.262455; 0.0345; 0.2
SMO = 1.77417; 0.15; 2.0 | 8.11458; 1.96; 12.6 | 1.74271; 0.0895; 1.8 | 4.81727; 0.444; 4.9
HGO = 3.26389; 0.142; 3.1 | 16.7527; 1.22; 15.5 | 2.64734; 0.107; 2.6 | 11.0026; 0.744; 10.5
HGOprinted = 1.28214; 0.0211; 3.1 | 10.1434; 0.163; 15.5 | 1.27836; 0.0161; 2.6 | 11.7999; .15; 10.5
HGO@10,70 = 0.492605; 0.0414 | 0.377945; 0.0577 | 0.400874; 0.0269 | 0.252631; 0.0331
HGOsub10 = 3.18402; 0.139; 3.1 | 15.9416; 1.17; 15.5 | 2.58212; 0.106; 2.6 | 10.4668; 0.713; 10.5

C*.# = 1 | 2 | 3
1 = 2.20034; 1e-05 | 1.79228; 1e-05 | 0.498907; 1e-05
2 = 0.084016; 0.1 % | 0.0377491; 0.1 % | 0.483789; 0.1 %

C3.#.* = HGO | SMO | GESO
ME1e2 = 2.03383; 0.749; 2.04 | 2.23795; 0.681; 2.14 | 1.13823; 0.209; 1.0
MSE1e4 = 6.51782; 3.59; 7.56 | 7.87114; 4.04; 7.25 | 3.51213; 0.704; 1.8
ME2e2 = 0.995984; 0.289; 1.04 | 3.2915; 0.621; 2.2 | 0.0532154; 0.00794; 0.14
MSE2e4 = 1.61138; 0.749; 1.79 | 16.6857; 6.47; 7.76 | 0.00840275; 0.0016; 0.06
ME3e2 = 0.504358; 0.13; 0.52 | 3.12851; 1.1; 0.86 | 0.0958371; 0.0202; 0.1
MSE3e4 = 0.39273; 0.188; 0.47 | 15.1644; 9; 0.98 | 0.0145085; 0.00604; 0.02

D1.*.# = q1; 0.0002 | q2; 0.0002
1120 = 2.81919 | 0.0200621
2463 = 3.14298 | -0.554705

D2.1: 6.2 max |d2q1| (central diff of 224 Hz samples), paper 39; 64.8147; 1 %; 39
D2.2: 6.2 max |d2q2|, paper 14; 28.6069; 1 %; 14
D2.3: 6.2 max |d2q1| if chirp amplitude 1.25 A; 38.1444; 1 %; 39
D2.4: 6.2 max |d2q2| if chirp amplitude 1.25 A; 15.5286; 1 %; 14

D3.*.# = ME1e2 | MSE1e4 | ME2e2
nominal.HPM.GESO = 8.15192; 0.68; 13.9 | 108.237; 12.6; 356.4 | 1.15093; 0.0753; 5.2
nominal.HPM.SMO-BL = 11.3536; 0.495; 15.2 | 195.772; 11.3; 376.4 | 3.95747; 0.158; 4.3
nominal.HPM.EHGO-BL = 6.6624; 0.258; 14.4 | 71.5061; 2.88; 359.2 | 2.76212; 0.105; 4.0
nominal.HPM.SMO-CV = 26.1592; 2; 28.8 | 999.027; 81; 1258.4 | 9.43073; 0.417; 9.3
nominal.HPM.EHGO-CV = 28.5558; 3.73; 45.4 | 1287.74; 303; 327.8 (for 3278) | 2.64831; 0.105; 3.5
nominal.HPM.GESO80 = 5.78533; 0.214; 13.9 | 54.0193; 2.48; 356.4 | 1.22279; 0.0557; 5.2
nominal.LPM.GESO = 74.0836; 12.3; 15.7 | 8859.4; 2.81e+03; 403.0 | 6.80069; 1.05; 5.1
nominal.LPM.SMO-BL = 14.3464; 1.12; 18.4 | 331.417; 34.7; 518.0 | 3.60412; 0.41; 5.5
nominal.LPM.EHGO-BL = 92.005; 3.1; 75.7 | 13726.3; 480; 9470.6 | 24.0309; 0.744; 24.2
nominal.LPM.SMO-CV = 30.9802; 2.11; 34.3 | 1489.94; 134; 1834.0 | 8.91544; 0.825; 10.1
nominal.LPM.EHGO-CV = 3079.74; 93.8; 1191.2 | 1.52357e+07; 4.65e+05; 2643e3 | 647.697; 19.7; 290.0
nominal.LPM.GESO80 = 6.3084; 0.376; 15.7 | 61.6155; 5.2; 403.0 | 1.1174; 0.11; 5.1
mismatch.HPM.GESO = 10.7791; 1.22; 13.9 | 192.799; 35.5; 356.4 | 5.46005; 0.368; 5.2
mismatch.HPM.SMO-BL = 11.3626; 0.604; 15.2 | 197.59; 15.6; 376.4 | 4.13454; 0.145; 4.3
mismatch.HPM.EHGO-BL = 7.08828; 0.26; 14.4 | 81.3069; 3.37; 359.2 | 2.87429; 0.0885; 4.0
mismatch.HPM.SMO-CV = 25.745; 1.29; 28.8 | 993.008; 55.8; 1258.4 | 9.44233; 0.382; 9.3
mismatch.HPM.EHGO-CV = 28.271; 3.85; 45.4 | 1244.69; 279; 327.8 (for 3278) | 2.65456; 0.106; 3.5
mismatch.HPM.GESO80 = 6.42459; 0.219; 13.9 | 64.3767; 2.47; 356.4 | 5.25582; 0.216; 5.2
mismatch.LPM.GESO = 77.2853; 10.9; 15.7 | 9667.08; 2.49e+03; 403.0 | 9.21574; 0.955; 5.1
mismatch.LPM.SMO-BL = 15.0283; 0.878; 18.4 | 364.564; 32; 518.0 | 4.22451; 0.307; 5.5
mismatch.LPM.EHGO-BL = 81.0569; 2.96; 75.7 | 10799.7; 445; 9470.6 | 23.6289; 0.736; 24.2
mismatch.LPM.SMO-CV = 32.1465; 1.84; 34.3 | 1592.2; 128; 1834.0 | 9.25492; 0.516; 10.1
mismatch.LPM.EHGO-CV = 2228.75; 68.8; 1191.2 | 8.48629e+06; 2.66e+05; 2643e3 | 760.287; 22.9; 290.0
mismatch.LPM.GESO80 = 6.70929; 0.421; 15.7 | 70.1373; 6.4; 403.0 | 5.17319; 0.267; 5.1

D4.ME1e2; 29.1899; 20 %; 15.7
D4.MSE1e4; 1335.61; 20 %; 403.0
D4.ME2e2; 3.70709; 20 %; 5.1
D5: 6.2 GESO printed gains, Euler 112 Hz: 1 if diverges; 1; 0

E#.* = 1; 0 | 2; 15 % | 3; 30 %
GESO.HPM = 0 | 0.441584;; 0.59 | 1.11013;; 1.08
GESO.LPM = 0 | 0.719364;; 1.03 | 1.41965;; 2.42
SMO-BL.HPM = 0 | 1.00798;; 0.93 | 2.18989;; 1.57
SMO-BL.LPM = 0 | 1.50248 | 3.96963
EHGO-BL.HPM = 0 | 0.482766 | 1.36545
EHGO-BL.LPM = 0 | 0.866312 | 1.88053
SMO-CV.HPM = 0 | 1.47862 | 3.72992
SMO-CV.LPM = 0 | 2.10493 | 7.26438
EHGO-CV.HPM = 0 | 1.69448 | 4.78179
EHGO-CV.LPM = 4 | - | -
GESO80.HPM = 0 | 0.440401 | 1.16503
GESO80.LPM = 0 | 0.643839 | 1.26143
EHGO.025.HPM = 0 | 0.477877 | 1.25734
EHGO.025.LPM = 0 | 0.726951 | 1.47356

F#.* = 1; 2 % | 2; 5 % | 3; 5 % | 4; 10 %
HPM.q1 = 0.0365451 | 0.0147855 | 0.0144115 | 0.0178361
HPM.q2 = 0.00288079 | 0.00211358 | 0.0017717 | 0.00166507
LPM.q1 = 0.277079 | 0.104005 | 0.0772808 | 0.099885
LPM.q2 = 0.0240732 | 0.0150587 | 0.0138253 | 0.0180203

G.#.* = tc=0.0 4096 cpr; 5 % | tc=0.0 1024 cpr; 5 % | tc=0.05 4096 cpr; 5 % | tc=0.05 1024 cpr; 5 %
no input, 2nd order = 0.068134 | 0.1254 | 0.0654194 | 0.124602
no input, 3rd order = 0.043201 | 0.0982988 | 0.0421816 | 0.102985
u exact = 0.000381056; 100 % | 0.000381727; 100 % | 0.0321529 | 0.0605391
u +5% = 0.0150358 | 0.0232089 | 0.0341842 | 0.0638155
u +10% = 0.02098 | 0.0342376 | 0.0363234 | 0.0679617
u +20% = 0.0302789 | 0.0510392 | 0.0410361 | 0.0760209
u +50% = 0.0503138 | 0.0866343 | 0.056335 | 0.103527
u 20 ms late = 0.0391512 | 0.0698835 | 0.0478176 | 0.0900845
u +20%, disturbance state = 0.023638 | 0.0481016 | 0.0278265 | 0.0624453

H1.*.# = 1; 25 % | 2; 25 %
0.0001.HGO = 0.00677318 | 0.00195994
0.0001.GESO sched y = 0.00675414 | 0.00201694
0.0001.GESO sched qhat = 0.00676055 | 0.00195555
0.01.HGO = 0.678559 | 0.132546
0.01.GESO sched y = 0.706054 | 0.376535
0.01.GESO sched qhat = 0.680188 | 0.134065

H2.#.* = 10; 10 % | 40; 10 %
GESO 10,70 = 0.0070013 | 0.0212589
HGO 10,70 = 0.0228182 | 1.12149
HGO 75,1250 = 0.0107956 | 0.586557
SMO 2.2,4 = 3.07471; 30 % | 56.4662; 30 %

H3.*.# = ME1e2; 15 % | MSE1e4; 15 % | ME2e2; 15 %
HPM.model divided by J_f = 5.95651;; 13.9 | 63.0802;; 356.4 | 7.73965;; 5.2
HPM.friction not in u = 14.6797;; 13.9 | 428.091;; 356.4 | 24.7069;; 5.2
LPM.model divided by J_f = 6.12747;; 15.7 | 67.1912;; 403.0 | 7.88867;; 5.1
LPM.friction not in u = 82.9594;; 15.7 | 10995.6;; 403.0 | 26.4047;; 5.1

H4.*.# = ME1e2; 10 % | MSE1e4; 10 % | ME2e2; 10 %
EHGO-BL = 58.4859;; 75.7 | 5458.32;; 9470.6 | 17.0226;; 24.2
EHGO-CV = 1133.27;; 1191.2 | 1.88543e+06;; 2643e3 | 410.44;; 290.0

H5.fixedR: HPM q1 with +-1 ms stamp jitter: RTS, R=q^2/12; 0.351549; 10 %
H5.R: same, R = (1.17e-3)^2 (what joint ML finds); 0.0307318; 10 %
"""


def references(start: str) -> tuple[Reference, ...]:
    """Return the references whose id starts with `start`, in order."""
    return tuple(reference for reference in ALL if reference.id.startswith(start))


def _read(table: str) -> Iterator[Reference]:
    for part in table.strip().split('\n\n'):
        first, *lines = part.splitlines()
        pattern, _, columns = first.partition(' = ')
        if '#' not in pattern:
            for line in (first, *lines):
                yield _reference(*_cell(line, 4))
            continue
        heads = [_cell(head, 2) for head in columns.split(' | ')]
        for line in lines:
            row, _, cells = line.partition(' = ')
            for (column, usual), cell in zip(heads, cells.split(' | '), strict=True):
                value, tolerance, paper = _cell(cell, 3)
                if value != NONE:
                    name = pattern.replace('*', row).replace('#', column)
                    yield _reference(name, value, tolerance or usual, paper)


def _cell(text: str, count: int) -> list[str]:
    """Return the first `count` parts of a text between semicolons; '' for missing ones."""
    return [part.strip() for part in (text + count * ';').split(';')[:count]]


def _reference(first: str, value: str, tolerance: str, paper: str) -> Reference:
    name, _, what = first.partition(': ')
    if not what:
        family, _, rest = name.partition('.')
        what = WORDS[family].format(rest=rest)
    number, _, percent = tolerance.partition(' ')
    kind = PERCENT if percent else EXACT if float(number) == 0.0 else ABSOLUTE
    allowed = float(number) * (0.01 * abs(float(value)) if percent else 1.0)
    if 0.0 < allowed < _half_a_digit(value):
        kind, number = ABSOLUTE, str(_half_a_digit(value))  # at least the rounding of the reference
    printed: float | str | None = None
    if paper:
        try:
            printed = float(paper)
        except ValueError:
            printed = paper
    return Reference(name, what, float(value), float(number), kind, printed)


def _half_a_digit(text: str) -> float:
    """Return half a unit of the last of the six printed digits of a reference."""
    value = abs(float(text))
    return 0.5 * 10.0 ** (math.floor(math.log10(value)) - 5) * (1.0 + 1e-9) if value else 0.0


ALL = tuple(_read(TABLE))
