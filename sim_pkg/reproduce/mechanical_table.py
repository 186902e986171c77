"""Reference rows of `reproduce mechanical`: id, value, tolerance, the paper's number.

The numbers come from an independent implementation, written from the paper alone. A tolerance is in
the unit of the value, or in %; it is never narrower than half a unit of the last digit printed.
What a row is stands after its id, or in `WORDS` for its whole family.
"""

from __future__ import annotations

import math

from sim_pkg.reproduce.contract import ABSOLUTE, EXACT, PERCENT, Reference

WORDS = {  # what the rows of a family are; {rest} is the id after the family
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
B1.1000.q1; 2.26235; 1e-06
B1.1000.q2; 0.278928; 1e-06
B1.1000.dq1; 1.35655; 1e-06
B1.1000.dq2; 0.444458; 1e-06
B1.14999.q1; 1.41963; 1e-06
B1.14999.q2; 5.26799; 1e-06
B1.14999.dq1; -0.506115; 1e-06
B1.14999.dq2; 0.365568; 1e-06
B2.GESO; -0.141895; 0.02 %
B3.GESO; 0.629; 3 %
B4.GESO.ME1e2; 0.494063; 0.0413; 0.5
B4.GESO.MSE1e4; 0.380245; 0.058; 0.3
B4.GESO.ME2e2; 0.408672; 0.027; 0.4
B4.GESO.MSE2e4; 0.262455; 0.0345; 0.2
B3.SMO; 0.212; 10 %
B4.SMO.ME1e2; 1.77417; 0.15; 2.0
B4.SMO.MSE1e4; 8.11458; 1.96; 12.6
B4.SMO.ME2e2; 1.74271; 0.0895; 1.8
B4.SMO.MSE2e4; 4.81727; 0.444; 4.9
B2.HGO; -0.00455508; 0.02 %
B3.HGO; 0.145; 3 %
B4.HGO.ME1e2; 3.26389; 0.142; 3.1
B4.HGO.MSE1e4; 16.7527; 1.22; 15.5
B4.HGO.ME2e2; 2.64734; 0.107; 2.6
B4.HGO.MSE2e4; 11.0026; 0.744; 10.5
B2.HGOprinted; -0.386821; 0.02 %
B3.HGOprinted; 3.676; 3 %
B4.HGOprinted.ME1e2; 1.28214; 0.0211; 3.1
B4.HGOprinted.MSE1e4; 10.1434; 0.163; 15.5
B4.HGOprinted.ME2e2; 1.27836; 0.0161; 2.6
B4.HGOprinted.MSE2e4; 11.7999; 0.15; 10.5
B2.HGO@10,70; -0.139369; 0.02 %
B3.HGO@10,70; 0.629; 3 %
B4.HGO@10,70.ME1e2; 0.492605; 0.0414
B4.HGO@10,70.MSE1e4; 0.377945; 0.0577
B4.HGO@10,70.ME2e2; 0.400874; 0.0269
B4.HGO@10,70.MSE2e4; 0.252631; 0.0331
B3.HGOsub10; 0.149; 3 %
B4.HGOsub10.ME1e2; 3.18402; 0.139; 3.1
B4.HGOsub10.MSE1e4; 15.9416; 1.17; 15.5
B4.HGOsub10.ME2e2; 2.58212; 0.106; 2.6
B4.HGOsub10.MSE2e4; 10.4668; 0.713; 10.5
C1.1; 2.20034; 1e-05
C1.2; 1.79228; 1e-05
C1.3; 0.498907; 1e-05
C2.1; 0.084016; 0.1 %
C2.2; 0.0377491; 0.1 %
C2.3; 0.483789; 0.1 %
C3.HGO.ME1e2; 2.03383; 0.749; 2.04
C3.HGO.MSE1e4; 6.51782; 3.59; 7.56
C3.HGO.ME2e2; 0.995984; 0.289; 1.04
C3.HGO.MSE2e4; 1.61138; 0.749; 1.79
C3.HGO.ME3e2; 0.504358; 0.13; 0.52
C3.HGO.MSE3e4; 0.39273; 0.188; 0.47
C3.SMO.ME1e2; 2.23795; 0.681; 2.14
C3.SMO.MSE1e4; 7.87114; 4.04; 7.25
C3.SMO.ME2e2; 3.2915; 0.621; 2.2
C3.SMO.MSE2e4; 16.6857; 6.47; 7.76
C3.SMO.ME3e2; 3.12851; 1.1; 0.86
C3.SMO.MSE3e4; 15.1644; 9; 0.98
C3.GESO.ME1e2; 1.13823; 0.209; 1.0
C3.GESO.MSE1e4; 3.51213; 0.704; 1.8
C3.GESO.ME2e2; 0.0532154; 0.00794; 0.14
C3.GESO.MSE2e4; 0.00840275; 0.0016; 0.06
C3.GESO.ME3e2; 0.0958371; 0.0202; 0.1
C3.GESO.MSE3e4; 0.0145085; 0.00604; 0.02
D1.1120.q1; 2.81919; 0.0002
D1.1120.q2; 0.0200621; 0.0002
D1.2463.q1; 3.14298; 0.0002
D1.2463.q2; -0.554705; 0.0002
D2.1: 6.2 max |d2q1| (central diff of 224 Hz samples), paper 39; 64.8147; 1 %; 39
D2.2: 6.2 max |d2q2|, paper 14; 28.6069; 1 %; 14
D2.3: 6.2 max |d2q1| if chirp amplitude 1.25 A; 38.1444; 1 %; 39
D2.4: 6.2 max |d2q2| if chirp amplitude 1.25 A; 15.5286; 1 %; 14
D3.nominal.HPM.GESO.ME1e2; 8.15192; 0.68; 13.9
D3.nominal.HPM.GESO.MSE1e4; 108.237; 12.6; 356.4
D3.nominal.HPM.GESO.ME2e2; 1.15093; 0.0753; 5.2
D3.nominal.HPM.SMO-BL.ME1e2; 11.3536; 0.495; 15.2
D3.nominal.HPM.SMO-BL.MSE1e4; 195.772; 11.3; 376.4
D3.nominal.HPM.SMO-BL.ME2e2; 3.95747; 0.158; 4.3
D3.nominal.HPM.EHGO-BL.ME1e2; 6.6624; 0.258; 14.4
D3.nominal.HPM.EHGO-BL.MSE1e4; 71.5061; 2.88; 359.2
D3.nominal.HPM.EHGO-BL.ME2e2; 2.76212; 0.105; 4.0
D3.nominal.HPM.SMO-CV.ME1e2; 26.1592; 2; 28.8
D3.nominal.HPM.SMO-CV.MSE1e4; 999.027; 81; 1258.4
D3.nominal.HPM.SMO-CV.ME2e2; 9.43073; 0.417; 9.3
D3.nominal.HPM.EHGO-CV.ME1e2; 28.5558; 3.73; 45.4
D3.nominal.HPM.EHGO-CV.MSE1e4; 1287.74; 303; 327.8 (for 3278)
D3.nominal.HPM.EHGO-CV.ME2e2; 2.64831; 0.105; 3.5
D3.nominal.HPM.GESO80.ME1e2; 5.78533; 0.214; 13.9
D3.nominal.HPM.GESO80.MSE1e4; 54.0193; 2.48; 356.4
D3.nominal.HPM.GESO80.ME2e2; 1.22279; 0.0557; 5.2
D3.nominal.LPM.GESO.ME1e2; 74.0836; 12.3; 15.7
D3.nominal.LPM.GESO.MSE1e4; 8859.4; 2.81e+03; 403.0
D3.nominal.LPM.GESO.ME2e2; 6.80069; 1.05; 5.1
D3.nominal.LPM.SMO-BL.ME1e2; 14.3464; 1.12; 18.4
D3.nominal.LPM.SMO-BL.MSE1e4; 331.417; 34.7; 518.0
D3.nominal.LPM.SMO-BL.ME2e2; 3.60412; 0.41; 5.5
D3.nominal.LPM.EHGO-BL.ME1e2; 92.005; 3.1; 75.7
D3.nominal.LPM.EHGO-BL.MSE1e4; 13726.3; 480; 9470.6
D3.nominal.LPM.EHGO-BL.ME2e2; 24.0309; 0.744; 24.2
D3.nominal.LPM.SMO-CV.ME1e2; 30.9802; 2.11; 34.3
D3.nominal.LPM.SMO-CV.MSE1e4; 1489.94; 134; 1834.0
D3.nominal.LPM.SMO-CV.ME2e2; 8.91544; 0.825; 10.1
D3.nominal.LPM.EHGO-CV.ME1e2; 3079.74; 93.8; 1191.2
D3.nominal.LPM.EHGO-CV.MSE1e4; 1.52357e+07; 4.65e+05; 2643000.0
D3.nominal.LPM.EHGO-CV.ME2e2; 647.697; 19.7; 290.0
D3.nominal.LPM.GESO80.ME1e2; 6.3084; 0.376; 15.7
D3.nominal.LPM.GESO80.MSE1e4; 61.6155; 5.2; 403.0
D3.nominal.LPM.GESO80.ME2e2; 1.1174; 0.11; 5.1
D3.mismatch.HPM.GESO.ME1e2; 10.7791; 1.22; 13.9
D3.mismatch.HPM.GESO.MSE1e4; 192.799; 35.5; 356.4
D3.mismatch.HPM.GESO.ME2e2; 5.46005; 0.368; 5.2
D3.mismatch.HPM.SMO-BL.ME1e2; 11.3626; 0.604; 15.2
D3.mismatch.HPM.SMO-BL.MSE1e4; 197.59; 15.6; 376.4
D3.mismatch.HPM.SMO-BL.ME2e2; 4.13454; 0.145; 4.3
D3.mismatch.HPM.EHGO-BL.ME1e2; 7.08828; 0.26; 14.4
D3.mismatch.HPM.EHGO-BL.MSE1e4; 81.3069; 3.37; 359.2
D3.mismatch.HPM.EHGO-BL.ME2e2; 2.87429; 0.0885; 4.0
D3.mismatch.HPM.SMO-CV.ME1e2; 25.745; 1.29; 28.8
D3.mismatch.HPM.SMO-CV.MSE1e4; 993.008; 55.8; 1258.4
D3.mismatch.HPM.SMO-CV.ME2e2; 9.44233; 0.382; 9.3
D3.mismatch.HPM.EHGO-CV.ME1e2; 28.271; 3.85; 45.4
D3.mismatch.HPM.EHGO-CV.MSE1e4; 1244.69; 279; 327.8 (for 3278)
D3.mismatch.HPM.EHGO-CV.ME2e2; 2.65456; 0.106; 3.5
D3.mismatch.HPM.GESO80.ME1e2; 6.42459; 0.219; 13.9
D3.mismatch.HPM.GESO80.MSE1e4; 64.3767; 2.47; 356.4
D3.mismatch.HPM.GESO80.ME2e2; 5.25582; 0.216; 5.2
D3.mismatch.LPM.GESO.ME1e2; 77.2853; 10.9; 15.7
D3.mismatch.LPM.GESO.MSE1e4; 9667.08; 2.49e+03; 403.0
D3.mismatch.LPM.GESO.ME2e2; 9.21574; 0.955; 5.1
D3.mismatch.LPM.SMO-BL.ME1e2; 15.0283; 0.878; 18.4
D3.mismatch.LPM.SMO-BL.MSE1e4; 364.564; 32; 518.0
D3.mismatch.LPM.SMO-BL.ME2e2; 4.22451; 0.307; 5.5
D3.mismatch.LPM.EHGO-BL.ME1e2; 81.0569; 2.96; 75.7
D3.mismatch.LPM.EHGO-BL.MSE1e4; 10799.7; 445; 9470.6
D3.mismatch.LPM.EHGO-BL.ME2e2; 23.6289; 0.736; 24.2
D3.mismatch.LPM.SMO-CV.ME1e2; 32.1465; 1.84; 34.3
D3.mismatch.LPM.SMO-CV.MSE1e4; 1592.2; 128; 1834.0
D3.mismatch.LPM.SMO-CV.ME2e2; 9.25492; 0.516; 10.1
D3.mismatch.LPM.EHGO-CV.ME1e2; 2228.75; 68.8; 1191.2
D3.mismatch.LPM.EHGO-CV.MSE1e4; 8.48629e+06; 2.66e+05; 2643000.0
D3.mismatch.LPM.EHGO-CV.ME2e2; 760.287; 22.9; 290.0
D3.mismatch.LPM.GESO80.ME1e2; 6.70929; 0.421; 15.7
D3.mismatch.LPM.GESO80.MSE1e4; 70.1373; 6.4; 403.0
D3.mismatch.LPM.GESO80.ME2e2; 5.17319; 0.267; 5.1
D4.ME1e2; 29.1899; 20 %; 15.7
D4.MSE1e4; 1335.61; 20 %; 403.0
D4.ME2e2; 3.70709; 20 %; 5.1
D5: 6.2 GESO printed gains, Euler 112 Hz: 1 if diverges; 1; 0
E1.GESO.HPM; 0; 0
E2.GESO.HPM; 0.441584; 15 %; 0.59
E3.GESO.HPM; 1.11013; 30 %; 1.08
E1.GESO.LPM; 0; 0
E2.GESO.LPM; 0.719364; 15 %; 1.03
E3.GESO.LPM; 1.41965; 30 %; 2.42
E1.SMO-BL.HPM; 0; 0
E2.SMO-BL.HPM; 1.00798; 15 %; 0.93
E3.SMO-BL.HPM; 2.18989; 30 %; 1.57
E1.SMO-BL.LPM; 0; 0
E2.SMO-BL.LPM; 1.50248; 15 %
E3.SMO-BL.LPM; 3.96963; 30 %
E1.EHGO-BL.HPM; 0; 0
E2.EHGO-BL.HPM; 0.482766; 15 %
E3.EHGO-BL.HPM; 1.36545; 30 %
E1.EHGO-BL.LPM; 0; 0
E2.EHGO-BL.LPM; 0.866312; 15 %
E3.EHGO-BL.LPM; 1.88053; 30 %
E1.SMO-CV.HPM; 0; 0
E2.SMO-CV.HPM; 1.47862; 15 %
E3.SMO-CV.HPM; 3.72992; 30 %
E1.SMO-CV.LPM; 0; 0
E2.SMO-CV.LPM; 2.10493; 15 %
E3.SMO-CV.LPM; 7.26438; 30 %
E1.EHGO-CV.HPM; 0; 0
E2.EHGO-CV.HPM; 1.69448; 15 %
E3.EHGO-CV.HPM; 4.78179; 30 %
E1.EHGO-CV.LPM; 4; 0
E1.GESO80.HPM; 0; 0
E2.GESO80.HPM; 0.440401; 15 %
E3.GESO80.HPM; 1.16503; 30 %
E1.GESO80.LPM; 0; 0
E2.GESO80.LPM; 0.643839; 15 %
E3.GESO80.LPM; 1.26143; 30 %
E1.EHGO.025.HPM; 0; 0
E2.EHGO.025.HPM; 0.477877; 15 %
E3.EHGO.025.HPM; 1.25734; 30 %
E1.EHGO.025.LPM; 0; 0
E2.EHGO.025.LPM; 0.726951; 15 %
E3.EHGO.025.LPM; 1.47356; 30 %
F1.HPM.q1; 0.0365451; 2 %
F2.HPM.q1; 0.0147855; 5 %
F3.HPM.q1; 0.0144115; 5 %
F4.HPM.q1; 0.0178361; 10 %
F1.HPM.q2; 0.00288079; 2 %
F2.HPM.q2; 0.00211358; 5 %
F3.HPM.q2; 0.0017717; 5 %
F4.HPM.q2; 0.00166507; 10 %
F1.LPM.q1; 0.277079; 2 %
F2.LPM.q1; 0.104005; 5 %
F3.LPM.q1; 0.0772808; 5 %
F4.LPM.q1; 0.099885; 10 %
F1.LPM.q2; 0.0240732; 2 %
F2.LPM.q2; 0.0150587; 5 %
F3.LPM.q2; 0.0138253; 5 %
F4.LPM.q2; 0.0180203; 10 %
G.tc=0.0 4096 cpr.no input, 2nd order; 0.068134; 5 %
G.tc=0.0 4096 cpr.no input, 3rd order; 0.043201; 5 %
G.tc=0.0 4096 cpr.u exact; 0.000381056; 100 %
G.tc=0.0 4096 cpr.u +5%; 0.0150358; 5 %
G.tc=0.0 4096 cpr.u +10%; 0.02098; 5 %
G.tc=0.0 4096 cpr.u +20%; 0.0302789; 5 %
G.tc=0.0 4096 cpr.u +50%; 0.0503138; 5 %
G.tc=0.0 4096 cpr.u 20 ms late; 0.0391512; 5 %
G.tc=0.0 4096 cpr.u +20%, disturbance state; 0.023638; 5 %
G.tc=0.0 1024 cpr.no input, 2nd order; 0.1254; 5 %
G.tc=0.0 1024 cpr.no input, 3rd order; 0.0982988; 5 %
G.tc=0.0 1024 cpr.u exact; 0.000381727; 100 %
G.tc=0.0 1024 cpr.u +5%; 0.0232089; 5 %
G.tc=0.0 1024 cpr.u +10%; 0.0342376; 5 %
G.tc=0.0 1024 cpr.u +20%; 0.0510392; 5 %
G.tc=0.0 1024 cpr.u +50%; 0.0866343; 5 %
G.tc=0.0 1024 cpr.u 20 ms late; 0.0698835; 5 %
G.tc=0.0 1024 cpr.u +20%, disturbance state; 0.0481016; 5 %
G.tc=0.05 4096 cpr.no input, 2nd order; 0.0654194; 5 %
G.tc=0.05 4096 cpr.no input, 3rd order; 0.0421816; 5 %
G.tc=0.05 4096 cpr.u exact; 0.0321529; 5 %
G.tc=0.05 4096 cpr.u +5%; 0.0341842; 5 %
G.tc=0.05 4096 cpr.u +10%; 0.0363234; 5 %
G.tc=0.05 4096 cpr.u +20%; 0.0410361; 5 %
G.tc=0.05 4096 cpr.u +50%; 0.056335; 5 %
G.tc=0.05 4096 cpr.u 20 ms late; 0.0478176; 5 %
G.tc=0.05 4096 cpr.u +20%, disturbance state; 0.0278265; 5 %
G.tc=0.05 1024 cpr.no input, 2nd order; 0.124602; 5 %
G.tc=0.05 1024 cpr.no input, 3rd order; 0.102985; 5 %
G.tc=0.05 1024 cpr.u exact; 0.0605391; 5 %
G.tc=0.05 1024 cpr.u +5%; 0.0638155; 5 %
G.tc=0.05 1024 cpr.u +10%; 0.0679617; 5 %
G.tc=0.05 1024 cpr.u +20%; 0.0760209; 5 %
G.tc=0.05 1024 cpr.u +50%; 0.103527; 5 %
G.tc=0.05 1024 cpr.u 20 ms late; 0.0900845; 5 %
G.tc=0.05 1024 cpr.u +20%, disturbance state; 0.0624453; 5 %
H1.0.0001.HGO.1; 0.00677318; 25 %
H1.0.0001.HGO.2; 0.00195994; 25 %
H1.0.0001.GESO sched y.1; 0.00675414; 25 %
H1.0.0001.GESO sched y.2; 0.00201694; 25 %
H1.0.0001.GESO sched qhat.1; 0.00676055; 25 %
H1.0.0001.GESO sched qhat.2; 0.00195555; 25 %
H1.0.01.HGO.1; 0.678559; 25 %
H1.0.01.HGO.2; 0.132546; 25 %
H1.0.01.GESO sched y.1; 0.706054; 25 %
H1.0.01.GESO sched y.2; 0.376535; 25 %
H1.0.01.GESO sched qhat.1; 0.680188; 25 %
H1.0.01.GESO sched qhat.2; 0.134065; 25 %
H2.10.GESO 10,70; 0.0070013; 10 %
H2.10.HGO 10,70; 0.0228182; 10 %
H2.10.HGO 75,1250; 0.0107956; 10 %
H2.10.SMO 2.2,4; 3.07471; 30 %
H2.40.GESO 10,70; 0.0212589; 10 %
H2.40.HGO 10,70; 1.12149; 10 %
H2.40.HGO 75,1250; 0.586557; 10 %
H2.40.SMO 2.2,4; 56.4662; 30 %
H3.HPM.model divided by J_f.ME1e2; 5.95651; 15 %; 13.9
H3.HPM.model divided by J_f.MSE1e4; 63.0802; 15 %; 356.4
H3.HPM.model divided by J_f.ME2e2; 7.73965; 15 %; 5.2
H3.HPM.friction not in u.ME1e2; 14.6797; 15 %; 13.9
H3.HPM.friction not in u.MSE1e4; 428.091; 15 %; 356.4
H3.HPM.friction not in u.ME2e2; 24.7069; 15 %; 5.2
H3.LPM.model divided by J_f.ME1e2; 6.12747; 15 %; 15.7
H3.LPM.model divided by J_f.MSE1e4; 67.1912; 15 %; 403.0
H3.LPM.model divided by J_f.ME2e2; 7.88867; 15 %; 5.1
H3.LPM.friction not in u.ME1e2; 82.9594; 15 %; 15.7
H3.LPM.friction not in u.MSE1e4; 10995.6; 15 %; 403.0
H3.LPM.friction not in u.ME2e2; 26.4047; 15 %; 5.1
H4.EHGO-BL.ME1e2; 58.4859; 10 %; 75.7
H4.EHGO-BL.MSE1e4; 5458.32; 10 %; 9470.6
H4.EHGO-BL.ME2e2; 17.0226; 10 %; 24.2
H4.EHGO-CV.ME1e2; 1133.27; 10 %; 1191.2
H4.EHGO-CV.MSE1e4; 1.88543e+06; 10 %; 2643000.0
H4.EHGO-CV.ME2e2; 410.44; 10 %; 290.0
H5.fixedR: HPM q1 with +-1 ms stamp jitter: RTS, R=q^2/12; 0.351549; 10 %
H5.R: same, R = (1.17e-3)^2 (what joint ML finds); 0.0307318; 10 %
"""


def references(start: str) -> tuple[Reference, ...]:
    """The rows whose id starts so, in their order."""
    return tuple(reference for reference in ALL if reference.id.startswith(start))


def _read(line: str) -> Reference:
    first, value, tolerance, paper = (part.strip() for part in f'{line};;;'.split(';')[:4])
    name, _, what = first.partition(': ')
    if not what:
        family, _, rest = name.partition('.')
        what = WORDS[family].format(rest=rest)
    number, _, percent = tolerance.partition(' ')
    kind = PERCENT if percent else EXACT if float(number) == 0.0 else ABSOLUTE
    allowed = float(number) * (0.01 * abs(float(value)) if percent else 1.0)
    if 0.0 < allowed < _half_a_digit(value):
        kind, number = ABSOLUTE, str(_half_a_digit(value))  # as exact as it is printed
    printed: float | str | None = None
    if paper:
        try:
            printed = float(paper)
        except ValueError:
            printed = paper
    return Reference(name, what, float(value), float(number), kind, printed)


def _half_a_digit(text: str) -> float:
    """Half a unit of the last of the six digits that a reference is printed with."""
    value = abs(float(text))
    return 0.5 * 10.0 ** (math.floor(math.log10(value)) - 5) * (1.0 + 1e-9) if value else 0.0


ALL = tuple(_read(line) for line in TABLE.strip().splitlines())
