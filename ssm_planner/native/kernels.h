/* Written by ssm_planner.elements.kernels with CasADi 3.8.2: do not edit. */

#define SSM_LOAD 38
#define SSM_MECHANISM 11
#define SSM_EYE 18
#define SSM_DRIVE 17
#define SSM_DEGREE 6
#define SSM_FREE_Q0 0
#define SSM_FREE_D 4
#define SSM_FREE_VELOCITY 8
#define SSM_FREE_ACCELERATION 12
#define SSM_FREE_JERK 16
#define SSM_FREE_TORQUE 20
#define SSM_FREE_COOLING 24
#define SSM_FREE_SPEEDS 28
#define SSM_FREE_STOP 29
#define SSM_FREE_RANGE_CENTRE 30
#define SSM_FREE_RANGE_HALF_WIDTH 32
#define SSM_FREE_RATE 34
#define SSM_FREE_RETINA_EASING 37
#define SSM_FREE_TIME_SCALE 38
#define SSM_FREE_SIZE 39
#define SSM_STRAIGHT_VELOCITY 0
#define SSM_STRAIGHT_ACCELERATION 4
#define SSM_STRAIGHT_JERK 8
#define SSM_STRAIGHT_TORQUE 12
#define SSM_STRAIGHT_COOLING 16
#define SSM_STRAIGHT_SPEEDS 20
#define SSM_STRAIGHT_STOP 21
#define SSM_STRAIGHT_TIME_SCALE 22
#define SSM_STRAIGHT_SIZE 23
#define SSM_PREPARED 102

static void prepare(const real *mechanism, const real *eye, const real *limits, real *restrict prepared)
{
 real w2, w3, w4, w5, w6, w7, w9, w10, w12, w13, w14, w17; real w18, w20, w21, r0, r1, r2, r3, r4, r5, r6, r7, r8;
 real r9, r10, r11, r12, r13, r14, r15, r16, r17, r18, r19, r20;
 real r21, r22, r23, r24, r25, r26, r27, r28, r29, r30, r31, r32;
 real r33, r34, r35, r36, r37, r38, r39, r40, r41, r42, r43, r44;
 real r45, r46, r47, r48, r49, r50, r51, r52, r53, r54, r55, r56;
 real r57, r58, r59, r60, r61, r62, r63, r64, r65, r66, r67, r68;
 real r69, r70, r71, r72, r73, r74, r75, r76, r77, r78, r79, r80;
 real r81, r82, r83, r84, r85, r86, r87, r88, r89, r90, r91, r92; real r93, r94, r95, r96, r97, r98, r99, r100, r101;
 w2 = mechanism[0] * mechanism[1]; r0 = w2; w4 = mechanism[0] * mechanism[0]; w5 = R(1.0) - w4; r1 = w5; r2 = w4;
 w6 = mechanism[1] * mechanism[0]; r3 = w6; w7 = mechanism[1] * mechanism[1]; w3 = R(1.0) - w7; r4 = w3; r5 = w7;
 w9 = limits[28] * limits[28]; r6 = w9; w10 = V(sin)(mechanism[5]); r7 = w10; w12 = mechanism[4] - mechanism[5];
 w12 = V(sin)(w12); r8 = w12; w13 = mechanism[4] + mechanism[5]; w13 = V(sin)(w13); r9 = w13;
 w14 = R(3.141592653589793) * mechanism[7]; w14 = w14 / R(2.0); r10 = w14; w14 = V(sin)(mechanism[4]); r11 = w14;
 r12 = w12; r13 = w13; r14 = w10; w13 = R(2.0) * w10; r15 = w13; w13 = mechanism[7] * w14; w13 = w13 * w10; r16 = w13;
 r17 = w14; r18 = w5; r19 = w4; r20 = w2; r21 = w6; r22 = w3; r23 = w7; w10 = eye[3] - eye[4]; w10 = w10 * w10;
 r24 = w10; r25 = w5; r26 = w4; r27 = w2; r28 = w6; r29 = w3; r30 = w7; w6 = eye[9] * eye[6]; w5 = eye[12] * eye[7];
 w6 = w6 + w5; w12 = eye[15] * eye[8]; w6 = w6 + w12; r31 = w6; w12 = eye[10] * eye[6]; w17 = eye[13] * eye[7];
 w12 = w12 + w17; w18 = eye[16] * eye[8]; w12 = w12 + w18; r32 = w12; w18 = eye[11] * eye[6]; w20 = eye[14] * eye[7];
 w18 = w18 + w20; w21 = eye[17] * eye[8]; w18 = w18 + w21; r33 = w18; r34 = mechanism[0]; r35 = mechanism[1];
 r36 = mechanism[2]; r37 = mechanism[3]; r38 = mechanism[4]; r39 = mechanism[5]; r40 = mechanism[6]; r41 = mechanism[7];
 r42 = mechanism[8]; r43 = mechanism[9]; r44 = mechanism[10]; r45 = eye[0]; r46 = eye[1]; r47 = eye[2]; r48 = eye[3];
 r49 = eye[4]; r50 = eye[5]; r51 = eye[6]; r52 = eye[7]; r53 = eye[8]; r54 = eye[9]; r55 = eye[10]; r56 = eye[11];
 r57 = eye[12]; r58 = eye[13]; r59 = eye[14]; r60 = eye[15]; r61 = eye[16]; r62 = eye[17]; r63 = limits[0];
 r64 = limits[1]; r65 = limits[2]; r66 = limits[3]; r67 = limits[4]; r68 = limits[5]; r69 = limits[6]; r70 = limits[7];
 r71 = limits[8]; r72 = limits[9]; r73 = limits[10]; r74 = limits[11]; r75 = limits[12]; r76 = limits[13];
 r77 = limits[14]; r78 = limits[15]; r79 = limits[16]; r80 = limits[17]; r81 = limits[18]; r82 = limits[19];
 r83 = limits[20]; r84 = limits[21]; r85 = limits[22]; r86 = limits[23]; r87 = limits[24]; r88 = limits[25];
 r89 = limits[26]; r90 = limits[27]; r91 = limits[28]; r92 = limits[29]; r93 = limits[30]; r94 = limits[31];
 r95 = limits[32]; r96 = limits[33]; r97 = limits[34]; r98 = limits[35]; r99 = limits[36]; r100 = limits[37];
 r101 = limits[38]; prepared[0] = r0; prepared[1] = r1; prepared[2] = r2; prepared[3] = r3; prepared[4] = r4;
 prepared[5] = r5; prepared[6] = r6; prepared[7] = r7; prepared[8] = r8; prepared[9] = r9; prepared[10] = r10;
 prepared[11] = r11; prepared[12] = r12; prepared[13] = r13; prepared[14] = r14; prepared[15] = r15; prepared[16] = r16;
 prepared[17] = r17; prepared[18] = r18; prepared[19] = r19; prepared[20] = r20; prepared[21] = r21; prepared[22] = r22;
 prepared[23] = r23; prepared[24] = r24; prepared[25] = r25; prepared[26] = r26; prepared[27] = r27; prepared[28] = r28;
 prepared[29] = r29; prepared[30] = r30; prepared[31] = r31; prepared[32] = r32; prepared[33] = r33; prepared[34] = r34;
 prepared[35] = r35; prepared[36] = r36; prepared[37] = r37; prepared[38] = r38; prepared[39] = r39; prepared[40] = r40;
 prepared[41] = r41; prepared[42] = r42; prepared[43] = r43; prepared[44] = r44; prepared[45] = r45; prepared[46] = r46;
 prepared[47] = r47; prepared[48] = r48; prepared[49] = r49; prepared[50] = r50; prepared[51] = r51; prepared[52] = r52;
 prepared[53] = r53; prepared[54] = r54; prepared[55] = r55; prepared[56] = r56; prepared[57] = r57; prepared[58] = r58;
 prepared[59] = r59; prepared[60] = r60; prepared[61] = r61; prepared[62] = r62; prepared[63] = r63; prepared[64] = r64;
 prepared[65] = r65; prepared[66] = r66; prepared[67] = r67; prepared[68] = r68; prepared[69] = r69; prepared[70] = r70;
 prepared[71] = r71; prepared[72] = r72; prepared[73] = r73; prepared[74] = r74; prepared[75] = r75; prepared[76] = r76;
 prepared[77] = r77; prepared[78] = r78; prepared[79] = r79; prepared[80] = r80; prepared[81] = r81; prepared[82] = r82;
 prepared[83] = r83; prepared[84] = r84; prepared[85] = r85; prepared[86] = r86; prepared[87] = r87; prepared[88] = r88;
 prepared[89] = r89; prepared[90] = r90; prepared[91] = r91; prepared[92] = r92; prepared[93] = r93; prepared[94] = r94;
 prepared[95] = r95; prepared[96] = r96; prepared[97] = r97; prepared[98] = r98; prepared[99] = r99;
 prepared[100] = r100; prepared[101] = r101;
}

static void tip_at(const real *prepared, const real *y, real *restrict g)
{
 real w0, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12; real w13, w14, w15, r0; w3 = V(sin)(y[1]);
 w5 = w3 * prepared[34]; w6 = prepared[37] * w5; w9 = w3 * prepared[35]; w10 = prepared[36] * w9; w6 = w6 - w10;
 w6 = y[3] * w6; w6 = w6 * y[4]; w12 = prepared[0] * w3; w12 = prepared[37] * w12; w14 = prepared[1] * w3;
 w14 = prepared[36] * w14; w12 = w12 - w14; w12 = y[3] * w12; w12 = w12 * y[5]; w6 = w6 + w12; w2 = V(cos)(y[1]);
 w13 = w2 * prepared[1]; w12 = prepared[2] + w13; w13 = w12 * prepared[36]; w15 = w2 * prepared[0];
 w11 = prepared[0] - w15; w15 = w11 * prepared[37]; w13 = w13 + w15; w13 = w13 * y[7]; w6 = w6 + w13; w6 = w6 * w6;
 w12 = prepared[36] * w12; w11 = prepared[37] * w11; w12 = w12 + w11; w12 = y[3] * w12; w12 = w12 * y[4];
 w8 = prepared[35] * w2; w8 = prepared[36] * w8; w4 = prepared[34] * w2; w4 = prepared[37] * w4; w8 = w8 - w4;
 w8 = y[3] * w8; w8 = w8 * y[5]; w12 = w12 + w8; w9 = w9 * prepared[36]; w5 = w5 * prepared[37]; w9 = w9 - w5;
 w9 = w9 * y[7]; w12 = w12 + w9; w12 = w12 * w12; w6 = w6 + w12; w9 = prepared[3] * w3; w9 = prepared[36] * w9;
 w3 = prepared[4] * w3; w3 = prepared[37] * w3; w9 = w9 - w3; w0 = y[3] * w9; w0 = w0 * y[5]; w14 = w2 * prepared[3];
 w12 = prepared[3] - w14; w12 = w12 * prepared[36]; w2 = w2 * prepared[4]; w7 = prepared[5] + w2;
 w7 = w7 * prepared[37]; w12 = w12 + w7; w12 = w12 * y[7]; w0 = w0 + w12; w0 = w0 * w0; w6 = w6 + w0;
 w6 = w6 / prepared[6]; r0 = w6; g[0] = r0;
}

static void tip_by(const real *prepared, const real *y, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35; real w36, w37, r0, r1, r2, r3, r4, r5;
 w3 = V(sin)(y[1]); w5 = w3 * prepared[34]; w6 = prepared[37] * w5; w9 = w3 * prepared[35]; w10 = prepared[36] * w9;
 w6 = w6 - w10; w10 = y[3] * w6; w12 = w10 * y[4]; w14 = prepared[0] * w3; w14 = prepared[37] * w14;
 w16 = prepared[1] * w3; w16 = prepared[36] * w16; w14 = w14 - w16; w16 = y[3] * w14; w18 = w16 * y[5]; w12 = w12 + w18;
 w2 = V(cos)(y[1]); w19 = w2 * prepared[1]; w18 = prepared[2] + w19; w19 = w18 * prepared[36]; w20 = w2 * prepared[0];
 w20 = prepared[0] - w20; w21 = w20 * prepared[37]; w19 = w19 + w21; w22 = w19 * y[7]; w12 = w12 + w22; w22 = w12 * w12;
 w18 = prepared[36] * w18; w20 = prepared[37] * w20; w18 = w18 + w20; w20 = y[3] * w18; w23 = w20 * y[4];
 w24 = prepared[35] * w2; w24 = prepared[36] * w24; w25 = prepared[34] * w2; w25 = prepared[37] * w25; w24 = w24 - w25;
 w25 = y[3] * w24; w26 = w25 * y[5]; w23 = w23 + w26; w9 = w9 * prepared[36]; w5 = w5 * prepared[37]; w9 = w9 - w5;
 w5 = w9 * y[7]; w23 = w23 + w5; w5 = w23 * w23; w22 = w22 + w5; w26 = prepared[3] * w3; w26 = prepared[36] * w26;
 w28 = prepared[4] * w3; w28 = prepared[37] * w28; w26 = w26 - w28; w28 = y[3] * w26; w29 = w28 * y[5];
 w30 = w2 * prepared[3]; w30 = prepared[3] - w30; w30 = w30 * prepared[36]; w32 = w2 * prepared[4];
 w31 = prepared[5] + w32; w31 = w31 * prepared[37]; w30 = w30 + w31; w31 = w30 * y[7]; w29 = w29 + w31; w31 = w29 * w29;
 w22 = w22 + w31; w22 = w22 / prepared[6]; r0 = w22; w29 = R(2.0) * w29; w29 = w29 / prepared[6]; w22 = y[5] * w29;
 w32 = y[3] * w22; w33 = prepared[36] * w32; w33 = prepared[3] * w33; w32 = prepared[37] * w32; w32 = prepared[4] * w32;
 w33 = w33 - w32; w12 = R(2.0) * w12; w12 = w12 / prepared[6]; w32 = y[5] * w12; w34 = y[3] * w32;
 w35 = prepared[36] * w34; w35 = prepared[1] * w35; w33 = w33 - w35; w34 = prepared[37] * w34; w34 = prepared[0] * w34;
 w33 = w33 + w34; w23 = R(2.0) * w23; w23 = w23 / prepared[6]; w31 = y[7] * w23; w34 = prepared[36] * w31;
 w35 = y[4] * w12; w36 = y[3] * w35; w37 = prepared[36] * w36; w34 = w34 - w37; w34 = prepared[35] * w34;
 w33 = w33 + w34; w36 = prepared[37] * w36; w31 = prepared[37] * w31; w36 = w36 - w31; w36 = prepared[34] * w36;
 w33 = w33 + w36; w2 = w2 * w33; w33 = y[7] * w29; w36 = prepared[37] * w33; w27 = prepared[4] * w36;
 w33 = prepared[36] * w33; w5 = prepared[3] * w33; w27 = w27 - w5; w17 = y[5] * w23; w5 = y[3] * w17;
 w33 = prepared[37] * w5; w4 = prepared[34] * w33; w27 = w27 - w4; w5 = prepared[36] * w5; w8 = prepared[35] * w5;
 w27 = w27 + w8; w11 = y[4] * w23; w0 = y[3] * w11; w8 = prepared[37] * w0; w21 = y[7] * w12; w1 = prepared[37] * w21;
 w8 = w8 + w1; w13 = prepared[0] * w8; w27 = w27 - w13; w0 = prepared[36] * w0; w7 = prepared[36] * w21; w0 = w0 + w7;
 w15 = prepared[1] * w0; w27 = w27 + w15; w3 = w3 * w27; w2 = w2 - w3; r1 = w2; w26 = w26 * w22; w24 = w24 * w17;
 w26 = w26 + w24; w18 = w18 * w11; w26 = w26 + w18; w14 = w14 * w32; w26 = w26 + w14; w6 = w6 * w35; w26 = w26 + w6;
 r2 = w26; w20 = w20 * w23; w10 = w10 * w12; w20 = w20 + w10; r3 = w20; w28 = w28 * w29; w25 = w25 * w23;
 w28 = w28 + w25; w16 = w16 * w12; w28 = w28 + w16; r4 = w28; w30 = w30 * w29; w9 = w9 * w23; w30 = w30 + w9;
 w19 = w19 * w12; w30 = w30 + w19; r5 = w30; g[0] = r0; by[1] = r1; by[3] = r2; by[4] = r3; by[5] = r4; by[7] = r5;
}

static void tip_bend(const real *prepared, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35;
 real w36, w37, w38, w39, w40, w41, w42, w43, w44, r0, r1, r2; real r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13, r14;
 w1 = V(cos)(y[1]); w6 = lam[0] / prepared[6]; w7 = prepared[3] * w1; w7 = prepared[36] * w7; w10 = prepared[4] * w1;
 w10 = prepared[37] * w10; w7 = w7 - w10; w7 = y[3] * w7; w7 = y[5] * w7; w0 = V(sin)(y[1]); w11 = prepared[3] * w0;
 w11 = prepared[36] * w11; w12 = prepared[4] * w0; w12 = prepared[37] * w12; w11 = w11 - w12; w12 = y[7] * w11;
 w7 = w7 + w12; w7 = R(2.0) * w7; w7 = w6 * w7; w12 = y[5] * w7; w12 = y[3] * w12; w13 = prepared[36] * w12;
 w13 = prepared[3] * w13; w12 = prepared[37] * w12; w12 = prepared[4] * w12; w13 = w13 - w12; w16 = prepared[34] * w1;
 w16 = prepared[37] * w16; w18 = prepared[35] * w1; w18 = prepared[36] * w18; w19 = w16 - w18; w19 = y[3] * w19;
 w19 = y[4] * w19; w21 = prepared[0] * w1; w21 = prepared[37] * w21; w22 = prepared[1] * w1; w22 = prepared[36] * w22;
 w21 = w21 - w22; w21 = y[3] * w21; w21 = y[5] * w21; w19 = w19 + w21; w21 = prepared[0] * w0; w21 = prepared[37] * w21;
 w22 = prepared[1] * w0; w22 = prepared[36] * w22; w21 = w21 - w22; w22 = y[7] * w21; w19 = w19 + w22;
 w19 = R(2.0) * w19; w19 = w6 * w19; w22 = y[5] * w19; w22 = y[3] * w22; w23 = prepared[36] * w22;
 w23 = prepared[1] * w23; w13 = w13 - w23; w22 = prepared[37] * w22; w22 = prepared[0] * w22; w13 = w13 + w22;
 w22 = y[3] * w21; w23 = y[4] * w22; w24 = prepared[34] * w0; w24 = prepared[37] * w24; w25 = prepared[35] * w0;
 w25 = prepared[36] * w25; w24 = w24 - w25; w24 = y[3] * w24; w24 = y[5] * w24; w23 = w23 + w24; w18 = w18 - w16;
 w16 = y[7] * w18; w23 = w23 + w16; w23 = R(2.0) * w23; w23 = w6 * w23; w16 = y[7] * w23; w24 = prepared[36] * w16;
 w25 = y[4] * w19; w25 = y[3] * w25; w26 = prepared[36] * w25; w24 = w24 - w26; w24 = prepared[35] * w24;
 w13 = w13 + w24; w25 = prepared[37] * w25; w16 = prepared[37] * w16; w25 = w25 - w16; w25 = prepared[34] * w25;
 w13 = w13 + w25; w13 = w1 * w13; w25 = y[3] * w11; w16 = w25 * y[5]; w24 = w1 * prepared[3]; w24 = prepared[3] - w24;
 w24 = w24 * prepared[36]; w27 = w1 * prepared[4]; w26 = prepared[5] + w27; w26 = w26 * prepared[37]; w24 = w24 + w26;
 w26 = w24 * y[7]; w16 = w16 + w26; w16 = R(2.0) * w16; w16 = w16 * w6; w26 = y[5] * w16; w27 = y[3] * w26;
 w28 = prepared[36] * w27; w28 = prepared[3] * w28; w27 = prepared[37] * w27; w27 = prepared[4] * w27; w28 = w28 - w27;
 w27 = w0 * prepared[34]; w29 = prepared[37] * w27; w30 = w0 * prepared[35]; w31 = prepared[36] * w30; w29 = w29 - w31;
 w31 = y[3] * w29; w32 = w31 * y[4]; w33 = w22 * y[5]; w32 = w32 + w33; w34 = w1 * prepared[1]; w33 = prepared[2] + w34;
 w34 = w33 * prepared[36]; w35 = w1 * prepared[0]; w35 = prepared[0] - w35; w36 = w35 * prepared[37]; w34 = w34 + w36;
 w36 = w34 * y[7]; w32 = w32 + w36; w32 = R(2.0) * w32; w32 = w32 * w6; w36 = y[5] * w32; w37 = y[3] * w36;
 w38 = prepared[36] * w37; w38 = prepared[1] * w38; w28 = w28 - w38; w37 = prepared[37] * w37; w37 = prepared[0] * w37;
 w28 = w28 + w37; w33 = prepared[36] * w33; w35 = prepared[37] * w35; w33 = w33 + w35; w35 = y[3] * w33;
 w37 = w35 * y[4]; w38 = y[3] * w18; w39 = w38 * y[5]; w37 = w37 + w39; w30 = w30 * prepared[36];
 w27 = w27 * prepared[37]; w30 = w30 - w27; w27 = w30 * y[7]; w37 = w37 + w27; w37 = R(2.0) * w37; w37 = w37 * w6;
 w27 = y[7] * w37; w39 = prepared[36] * w27; w40 = y[4] * w32; w41 = y[3] * w40; w42 = prepared[36] * w41;
 w39 = w39 - w42; w39 = prepared[35] * w39; w28 = w28 + w39; w41 = prepared[37] * w41; w27 = prepared[37] * w27;
 w41 = w41 - w27; w41 = prepared[34] * w41; w28 = w28 + w41; w28 = w28 * w0; w13 = w13 - w28; w28 = y[7] * w16;
 w41 = prepared[37] * w28; w41 = prepared[4] * w41; w28 = prepared[36] * w28; w28 = prepared[3] * w28; w41 = w41 - w28;
 w28 = y[5] * w37; w27 = y[3] * w28; w39 = prepared[37] * w27; w39 = prepared[34] * w39; w41 = w41 - w39;
 w27 = prepared[36] * w27; w27 = prepared[35] * w27; w41 = w41 + w27; w27 = y[4] * w37; w39 = y[3] * w27;
 w42 = prepared[37] * w39; w43 = y[7] * w32; w44 = prepared[37] * w43; w42 = w42 + w44; w42 = prepared[0] * w42;
 w41 = w41 - w42; w39 = prepared[36] * w39; w43 = prepared[36] * w43; w39 = w39 + w43; w39 = prepared[1] * w39;
 w41 = w41 + w39; w41 = w41 * w1; w7 = y[7] * w7; w39 = prepared[37] * w7; w39 = prepared[4] * w39;
 w7 = prepared[36] * w7; w7 = prepared[3] * w7; w39 = w39 - w7; w7 = y[5] * w23; w7 = y[3] * w7;
 w43 = prepared[37] * w7; w43 = prepared[34] * w43; w39 = w39 - w43; w7 = prepared[36] * w7; w7 = prepared[35] * w7;
 w39 = w39 + w7; w23 = y[4] * w23; w23 = y[3] * w23; w7 = prepared[37] * w23; w19 = y[7] * w19;
 w43 = prepared[37] * w19; w7 = w7 + w43; w7 = prepared[0] * w7; w39 = w39 - w7; w23 = prepared[36] * w23;
 w19 = prepared[36] * w19; w23 = w23 + w19; w23 = prepared[1] * w23; w39 = w39 + w23; w39 = w0 * w39; w41 = w41 + w39;
 w13 = w13 - w41; r0 = w13; w13 = y[5] * w11; w13 = R(2.0) * w13; w13 = w6 * w13; w41 = y[5] * w13; w39 = y[3] * w41;
 w26 = w26 + w39; w39 = prepared[36] * w26; w39 = prepared[3] * w39; w26 = prepared[37] * w26; w26 = prepared[4] * w26;
 w39 = w39 - w26; w26 = y[4] * w29; w23 = y[5] * w21; w26 = w26 + w23; w26 = R(2.0) * w26; w26 = w6 * w26;
 w23 = y[5] * w26; w19 = y[3] * w23; w36 = w36 + w19; w19 = prepared[36] * w36; w19 = prepared[1] * w19;
 w39 = w39 - w19; w36 = prepared[37] * w36; w36 = prepared[0] * w36; w39 = w39 + w36; w36 = y[4] * w33;
 w19 = y[5] * w18; w36 = w36 + w19; w36 = R(2.0) * w36; w36 = w6 * w36; w19 = y[7] * w36; w7 = prepared[36] * w19;
 w43 = y[4] * w26; w42 = y[3] * w43; w40 = w40 + w42; w42 = prepared[36] * w40; w7 = w7 - w42; w7 = prepared[35] * w7;
 w39 = w39 + w7; w40 = prepared[37] * w40; w19 = prepared[37] * w19; w40 = w40 - w19; w40 = prepared[34] * w40;
 w39 = w39 + w40; w39 = w1 * w39; w13 = y[7] * w13; w40 = prepared[37] * w13; w40 = prepared[4] * w40;
 w13 = prepared[36] * w13; w13 = prepared[3] * w13; w40 = w40 - w13; w13 = y[5] * w36; w19 = y[3] * w13;
 w28 = w28 + w19; w19 = prepared[37] * w28; w19 = prepared[34] * w19; w40 = w40 - w19; w28 = prepared[36] * w28;
 w28 = prepared[35] * w28; w40 = w40 + w28; w36 = y[4] * w36; w28 = y[3] * w36; w27 = w27 + w28;
 w28 = prepared[37] * w27; w26 = y[7] * w26; w19 = prepared[37] * w26; w28 = w28 + w19; w28 = prepared[0] * w28;
 w40 = w40 - w28; w27 = prepared[36] * w27; w26 = prepared[36] * w26; w27 = w27 + w26; w27 = prepared[1] * w27;
 w40 = w40 + w27; w40 = w0 * w40; w39 = w39 - w40; r1 = w39; w41 = w11 * w41; w13 = w18 * w13; w41 = w41 + w13;
 w36 = w33 * w36; w41 = w41 + w36; w23 = w21 * w23; w41 = w41 + w23; w43 = w29 * w43; w41 = w41 + w43; r2 = w41;
 w41 = R(2.0) * w31; w41 = w6 * w41; w43 = y[5] * w41; w23 = y[3] * w43; w36 = prepared[37] * w23;
 w36 = prepared[0] * w36; w23 = prepared[36] * w23; w23 = prepared[1] * w23; w36 = w36 - w23; w23 = R(2.0) * w35;
 w23 = w6 * w23; w13 = y[7] * w23; w39 = prepared[36] * w13; w40 = y[4] * w41; w40 = w32 + w40; w27 = y[3] * w40;
 w26 = prepared[36] * w27; w39 = w39 - w26; w39 = prepared[35] * w39; w36 = w36 + w39; w27 = prepared[37] * w27;
 w13 = prepared[37] * w13; w27 = w27 - w13; w27 = prepared[34] * w27; w36 = w36 + w27; w36 = w1 * w36; w27 = y[5] * w23;
 w13 = y[3] * w27; w39 = prepared[36] * w13; w39 = prepared[35] * w39; w13 = prepared[37] * w13;
 w13 = prepared[34] * w13; w39 = w39 - w13; w13 = y[4] * w23; w13 = w37 + w13; w26 = y[3] * w13;
 w28 = prepared[37] * w26; w19 = y[7] * w41; w7 = prepared[37] * w19; w28 = w28 + w7; w28 = prepared[0] * w28;
 w39 = w39 - w28; w26 = prepared[36] * w26; w19 = prepared[36] * w19; w26 = w26 + w19; w26 = prepared[1] * w26;
 w39 = w39 + w26; w39 = w0 * w39; w36 = w36 - w39; r3 = w36; w27 = w18 * w27; w13 = w33 * w13; w27 = w27 + w13;
 w43 = w21 * w43; w27 = w27 + w43; w40 = w29 * w40; w27 = w27 + w40; r4 = w27; w23 = w35 * w23; w41 = w31 * w41;
 w23 = w23 + w41; r5 = w23; w23 = R(2.0) * w25; w23 = w6 * w23; w41 = y[5] * w23; w41 = w16 + w41; w27 = y[3] * w41;
 w40 = prepared[36] * w27; w40 = prepared[3] * w40; w27 = prepared[37] * w27; w27 = prepared[4] * w27; w40 = w40 - w27;
 w27 = R(2.0) * w22; w27 = w6 * w27; w43 = y[5] * w27; w43 = w32 + w43; w13 = y[3] * w43; w36 = prepared[36] * w13;
 w36 = prepared[1] * w36; w40 = w40 - w36; w13 = prepared[37] * w13; w13 = prepared[0] * w13; w40 = w40 + w13;
 w13 = R(2.0) * w38; w13 = w6 * w13; w36 = y[7] * w13; w39 = prepared[36] * w36; w26 = y[4] * w27; w19 = y[3] * w26;
 w28 = prepared[36] * w19; w39 = w39 - w28; w39 = prepared[35] * w39; w40 = w40 + w39; w19 = prepared[37] * w19;
 w36 = prepared[37] * w36; w19 = w19 - w36; w19 = prepared[34] * w19; w40 = w40 + w19; w40 = w1 * w40; w19 = y[7] * w23;
 w36 = prepared[37] * w19; w36 = prepared[4] * w36; w19 = prepared[36] * w19; w19 = prepared[3] * w19; w36 = w36 - w19;
 w19 = y[5] * w13; w19 = w37 + w19; w39 = y[3] * w19; w28 = prepared[37] * w39; w28 = prepared[34] * w28;
 w36 = w36 - w28; w39 = prepared[36] * w39; w39 = prepared[35] * w39; w36 = w36 + w39; w39 = y[4] * w13;
 w28 = y[3] * w39; w7 = prepared[37] * w28; w42 = y[7] * w27; w44 = prepared[37] * w42; w7 = w7 + w44;
 w7 = prepared[0] * w7; w36 = w36 - w7; w28 = prepared[36] * w28; w42 = prepared[36] * w42; w28 = w28 + w42;
 w28 = prepared[1] * w28; w36 = w36 + w28; w36 = w0 * w36; w40 = w40 - w36; r6 = w40; w41 = w11 * w41; w19 = w18 * w19;
 w41 = w41 + w19; w39 = w33 * w39; w41 = w41 + w39; w43 = w21 * w43; w41 = w41 + w43; w26 = w29 * w26; w41 = w41 + w26;
 r7 = w41; w41 = w35 * w13; w26 = w31 * w27; w41 = w41 + w26; r8 = w41; w23 = w25 * w23; w13 = w38 * w13;
 w23 = w23 + w13; w27 = w22 * w27; w23 = w23 + w27; r9 = w23; w23 = R(2.0) * w24; w23 = w6 * w23; w27 = y[5] * w23;
 w13 = y[3] * w27; w41 = prepared[36] * w13; w41 = prepared[3] * w41; w13 = prepared[37] * w13; w13 = prepared[4] * w13;
 w41 = w41 - w13; w13 = R(2.0) * w34; w13 = w6 * w13; w26 = y[5] * w13; w43 = y[3] * w26; w39 = prepared[36] * w43;
 w39 = prepared[1] * w39; w41 = w41 - w39; w43 = prepared[37] * w43; w43 = prepared[0] * w43; w41 = w41 + w43;
 w43 = R(2.0) * w30; w6 = w6 * w43; w43 = y[7] * w6; w37 = w37 + w43; w43 = prepared[36] * w37; w39 = y[4] * w13;
 w19 = y[3] * w39; w40 = prepared[36] * w19; w43 = w43 - w40; w43 = prepared[35] * w43; w41 = w41 + w43;
 w19 = prepared[37] * w19; w37 = prepared[37] * w37; w19 = w19 - w37; w19 = prepared[34] * w19; w41 = w41 + w19;
 w1 = w1 * w41; w41 = y[7] * w23; w16 = w16 + w41; w41 = prepared[37] * w16; w9 = prepared[4] * w41;
 w16 = prepared[36] * w16; w2 = prepared[3] * w16; w9 = w9 - w2; w5 = y[5] * w6; w2 = y[3] * w5;
 w16 = prepared[37] * w2; w15 = prepared[34] * w16; w9 = w9 - w15; w2 = prepared[36] * w2; w17 = prepared[35] * w2;
 w9 = w9 + w17; w14 = y[4] * w6; w4 = y[3] * w14; w17 = prepared[37] * w4; w10 = y[7] * w13; w32 = w32 + w10;
 w8 = prepared[37] * w32; w17 = w17 + w8; w20 = prepared[0] * w17; w9 = w9 - w20; w4 = prepared[36] * w4;
 w3 = prepared[36] * w32; w4 = w4 + w3; w12 = prepared[1] * w4; w9 = w9 + w12; w0 = w0 * w9; w1 = w1 - w0; r10 = w1;
 w11 = w11 * w27; w18 = w18 * w5; w11 = w11 + w18; w33 = w33 * w14; w11 = w11 + w33; w21 = w21 * w26; w11 = w11 + w21;
 w29 = w29 * w39; w11 = w11 + w29; r11 = w11; w35 = w35 * w6; w31 = w31 * w13; w35 = w35 + w31; r12 = w35;
 w25 = w25 * w23; w38 = w38 * w6; w25 = w25 + w38; w22 = w22 * w13; w25 = w25 + w22; r13 = w25; w24 = w24 * w23;
 w30 = w30 * w6; w24 = w24 + w30; w34 = w34 * w13; w24 = w24 + w34; r14 = w24; bend[13] += r0; bend[15] += r1;
 bend[39] += r2; bend[16] += r3; bend[40] += r4; bend[52] += r5; bend[17] += r6; bend[41] += r7; bend[53] += r8;
 bend[65] += r9; bend[19] += r10; bend[43] += r11; bend[55] += r12; bend[67] += r13; bend[91] += r14;
}

static void ranges_at(const real *prepared, const real *y, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, r0, r1, r2, r3; w3 = y[1] - prepared[44]; w3 = w3 - prepared[40]; w3 = w3 / R(2.0);
 w4 = V(sin)(w3); w3 = V(cos)(w3); w5 = w4 * w3; w2 = (-R(2.0)) * w5; w1 = prepared[7] * w2; w3 = w3 * w3;
 w5 = prepared[8] * w3; w4 = w4 * w4; w3 = prepared[9] * w4; w4 = w5 + w3; w1 = V(atan2)(w1, w4); w0 = y[0] + w1;
 w0 = w0 + prepared[10]; w0 = w0 - prepared[93]; w0 = w0 / prepared[95]; r0 = w0; w0 = -w0; r1 = w0;
 w1 = prepared[11] * w2; w5 = w5 - w3; w1 = V(atan2)(w1, w5); w0 = y[2] - w1; w0 = w0 + prepared[42];
 w0 = w0 - prepared[94]; w0 = w0 / prepared[96]; r2 = w0; w0 = -w0; r3 = w0; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3;
}

static void ranges_by(const real *prepared, const real *y, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, r0, r1, r2, r3, r4, r5;
 real r6, r7, r8, r9, r10, r11; w3 = y[1] - prepared[44]; w3 = w3 - prepared[40]; w3 = w3 / R(2.0); w4 = V(sin)(w3);
 w3 = V(cos)(w3); w5 = w4 * w3; w5 = (-R(2.0)) * w5; w6 = prepared[7] * w5; w8 = w3 * w3; w8 = prepared[8] * w8;
 w10 = w4 * w4; w10 = prepared[9] * w10; w11 = w8 + w10; w12 = V(atan2)(w6, w11); w0 = y[0] + w12;
 w0 = w0 + prepared[10]; w0 = w0 - prepared[93]; w0 = w0 / prepared[95]; r0 = w0; w0 = -w0; r1 = w0;
 w5 = prepared[11] * w5; w8 = w8 - w10; w10 = V(atan2)(w5, w8); w0 = y[2] - w10; w0 = w0 + prepared[42];
 w0 = w0 - prepared[94]; w0 = w0 / prepared[96]; r2 = w0; w0 = -w0; r3 = w0; w0 = R(1.0) / prepared[95]; r4 = w0;
 w0 = -w0; r5 = w0; w0 = w6 * w6; w14 = w11 * w11; w0 = w0 + w14; w11 = w11 / w0; w15 = R(0.5) * w3; w16 = w3 * w15;
 w14 = R(0.5) * w4; w17 = w4 * w14; w16 = w16 - w17; w2 = (-R(2.0)) * w16; w1 = prepared[7] * w2; w11 = w11 * w1;
 w6 = w6 / w0; w4 = R(2.0) * w4; w4 = w4 * w15; w9 = prepared[9] * w4; w3 = R(2.0) * w3; w3 = w3 * w14;
 w7 = prepared[8] * w3; w3 = w9 - w7; w6 = w6 * w3; w11 = w11 - w6; w11 = w11 / prepared[95]; r6 = w11; w11 = -w11;
 r7 = w11; w11 = w5 * w5; w12 = w8 * w8; w11 = w11 + w12; w8 = w8 / w11; w13 = prepared[11] * w2; w8 = w8 * w13;
 w5 = w5 / w11; w7 = w7 + w9; w5 = w5 * w7; w8 = w8 + w5; w8 = w8 / prepared[96]; w5 = -w8; r8 = w5; r9 = w8;
 w10 = R(1.0) / prepared[96]; r10 = w10; w10 = -w10; r11 = w10; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3; by[0] = r4;
 by[12] = r5; by[1] = r6; by[13] = r7; by[25] = r8; by[37] = r9; by[26] = r10; by[38] = r11;
}

static void ranges_bend(const real *prepared, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, r0; w1 = y[1] - prepared[44]; w1 = w1 - prepared[40]; w1 = w1 / R(2.0); w2 = V(cos)(w1);
 w5 = lam[0] - lam[1]; w5 = w5 / prepared[95]; w1 = V(sin)(w1); w7 = R(2.0) * w1; w8 = R(0.5) * w2; w9 = w7 * w8;
 w9 = prepared[9] * w9; w11 = R(2.0) * w2; w12 = R(0.5) * w1; w13 = w11 * w12; w13 = prepared[8] * w13; w14 = w9 - w13;
 w15 = w1 * w2; w15 = (-R(2.0)) * w15; w16 = prepared[7] * w15; w17 = w16 * w16; w18 = w2 * w2; w18 = prepared[8] * w18;
 w19 = w1 * w1; w19 = prepared[9] * w19; w20 = w18 + w19; w21 = w20 * w20; w17 = w17 + w21; w21 = w14 / w17;
 w22 = w20 / w17; w23 = w22 / w17; w24 = R(2.0) * w16; w25 = w2 * w8; w26 = w1 * w12; w25 = w25 - w26;
 w25 = (-R(2.0)) * w25; w26 = prepared[7] * w25; w24 = w24 * w26; w20 = R(2.0) * w20; w20 = w20 * w14; w24 = w24 + w20;
 w23 = w23 * w24; w21 = w21 - w23; w21 = w5 * w21; w21 = prepared[7] * w21; w20 = lam[2] - lam[3];
 w20 = w20 / prepared[96]; w13 = w13 + w9; w15 = prepared[11] * w15; w9 = w15 * w15; w18 = w18 - w19; w19 = w18 * w18;
 w9 = w9 + w19; w19 = w13 / w9; w14 = w18 / w9; w27 = w14 / w9; w28 = R(2.0) * w15; w25 = prepared[11] * w25;
 w28 = w28 * w25; w18 = R(2.0) * w18; w18 = w18 * w13; w28 = w28 - w18; w27 = w27 * w28; w19 = w19 + w27;
 w19 = w20 * w19; w19 = prepared[11] * w19; w21 = w21 + w19; w21 = (-R(2.0)) * w21; w19 = w2 * w21; w22 = w22 * w5;
 w4 = prepared[7] * w22; w14 = w14 * w20; w23 = prepared[11] * w14; w4 = w4 - w23; w3 = (-R(2.0)) * w4; w4 = w3 * w12;
 w19 = w19 - w4; w15 = w15 / w9; w4 = w15 * w20; w16 = w16 / w17; w23 = w16 * w5; w14 = w4 + w23;
 w14 = prepared[9] * w14; w22 = w14 * w2; w25 = w25 / w9; w15 = w15 / w9; w15 = w15 * w28; w25 = w25 - w15;
 w20 = w20 * w25; w26 = w26 / w17; w16 = w16 / w17; w16 = w16 * w24; w26 = w26 - w16; w5 = w5 * w26; w26 = w20 + w5;
 w6 = prepared[9] * w26; w6 = w7 * w6; w22 = w22 + w6; w19 = w19 - w22; w19 = w2 * w19; w2 = w2 * w3; w7 = w7 * w14;
 w2 = w2 - w7; w2 = w2 * w12; w19 = w19 - w2; w4 = w4 - w23; w4 = prepared[8] * w4; w23 = w11 * w4; w2 = w1 * w3;
 w23 = w23 + w2; w23 = w23 * w8; w12 = -w12; w12 = R(2.0) * w12; w4 = w4 * w12; w20 = w20 - w5; w10 = prepared[8] * w20;
 w11 = w11 * w10; w4 = w4 + w11; w3 = w3 * w8; w21 = w1 * w21; w3 = w3 + w21; w4 = w4 + w3; w1 = w1 * w4;
 w23 = w23 + w1; w19 = w19 - w23; w0 = R(0.5) * w19; r0 = w0; bend[13] += r0;
}

static void rates_at(const real *prepared, const real *y, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, r0, r1, r2, r3; real r4, r5; w3 = y[1] - prepared[44]; w3 = w3 - prepared[40];
 w3 = w3 / R(2.0); w4 = V(cos)(w3); w5 = w4 * w4; w2 = prepared[12] * w5; w3 = V(sin)(w3); w6 = w3 * w3;
 w5 = prepared[13] * w6; w6 = w2 - w5; w1 = prepared[14] * w6; w2 = w2 + w5; w5 = w2 * w2; w7 = prepared[15] * w3;
 w7 = w7 * w4; w7 = w7 * w7; w5 = w5 + w7; w6 = V(is)(R(0.0) < w5); w5 = V(where)(w6 != R(0.0), w5);
 w6 = V(is)(w6 == R(0.0)); w6 = V(where)(w6 != R(0.0), R(1.0)); w5 = w5 + w6; w1 = w1 / w5; w1 = w1 * y[5];
 w0 = y[4] - w1; w0 = w0 / prepared[97]; r0 = w0; w0 = -w0; r1 = w0; w3 = R(2.0) * w3; w3 = w3 * w4;
 w0 = prepared[16] * w3; w3 = V(sqrt)(w5); w0 = w0 / w3; w0 = w0 * y[5]; w0 = w0 / prepared[98]; r2 = w0; w0 = -w0;
 r3 = w0; w3 = prepared[17] * w2; w3 = w3 / w5; w3 = w3 * y[5]; w0 = y[6] + w3; w0 = w0 / prepared[99]; r4 = w0;
 w0 = -w0; r5 = w0; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3; g[4] = r4; g[5] = r5;
}

static void rates_by(const real *prepared, const real *y, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w21, w22, w23, w24;
 real w25, w26, r0, r1, r2, r3, r4, r5, r6, r7, r8, r9; real r10, r11, r12, r13, r14, r15, r16, r17, r18, r19, r20, r21;
 w3 = y[1] - prepared[44]; w3 = w3 - prepared[40]; w3 = w3 / R(2.0); w4 = V(cos)(w3); w5 = w4 * w4;
 w6 = prepared[12] * w5; w3 = V(sin)(w3); w8 = w3 * w3; w8 = prepared[13] * w8; w9 = w6 - w8; w9 = prepared[14] * w9;
 w6 = w6 + w8; w8 = w6 * w6; w12 = prepared[15] * w3; w13 = w12 * w4; w14 = w13 * w13; w8 = w8 + w14;
 w10 = V(is)(R(0.0) < w8); w8 = V(where)(w10 != R(0.0), w8); w14 = V(is)(w10 == R(0.0));
 w14 = V(where)(w14 != R(0.0), R(1.0)); w8 = w8 + w14; w9 = w9 / w8; w15 = w9 * y[5]; w0 = y[4] - w15;
 w0 = w0 / prepared[97]; r0 = w0; w0 = -w0; r1 = w0; w16 = R(2.0) * w3; w17 = w16 * w4; w17 = prepared[16] * w17;
 w18 = V(sqrt)(w8); w17 = w17 / w18; w19 = w17 * y[5]; w19 = w19 / prepared[98]; r2 = w19; w19 = -w19; r3 = w19;
 w22 = prepared[17] * w6; w22 = w22 / w8; w23 = w22 * y[5]; w19 = y[6] + w23; w19 = w19 / prepared[99]; r4 = w19;
 w19 = -w19; r5 = w19; w19 = w9 / w8; w6 = R(2.0) * w6; w25 = R(0.5) * w4; w26 = w16 * w25; w7 = prepared[13] * w26;
 w26 = R(2.0) * w4; w24 = R(0.5) * w3; w26 = w26 * w24; w2 = prepared[12] * w26; w26 = w7 - w2; w6 = w6 * w26;
 w13 = R(2.0) * w13; w11 = prepared[15] * w25; w4 = w4 * w11; w12 = w12 * w24; w4 = w4 - w12; w13 = w13 * w4;
 w6 = w6 + w13; w19 = w19 * w6; w19 = -w19; w19 = V(where)(w10 != R(0.0), w19); w2 = w2 + w7; w1 = prepared[14] * w2;
 w1 = w1 / w8; w19 = w19 - w1; w19 = y[5] * w19; w19 = w19 / prepared[97]; w1 = -w19; r6 = w1; r7 = w19;
 w16 = w16 * w24; w5 = w5 - w16; w0 = prepared[16] * w5; w0 = w0 / w18; w5 = w17 / w18; w18 = R(2.0) * w18;
 w18 = w6 / w18; w5 = w5 * w18; w5 = -w5; w5 = V(where)(w10 != R(0.0), w5); w0 = w0 + w5; w0 = y[5] * w0;
 w0 = w0 / prepared[98]; r8 = w0; w0 = -w0; r9 = w0; w21 = prepared[17] * w26; w21 = w21 / w8; w8 = w22 / w8;
 w8 = w8 * w6; w8 = -w8; w10 = V(where)(w10 != R(0.0), w8); w21 = w21 + w10; w14 = y[5] * w21; w14 = w14 / prepared[99];
 r10 = w14; w14 = -w14; r11 = w14; w14 = R(1.0) / prepared[97]; r12 = w14; w14 = -w14; r13 = w14;
 w9 = w9 / prepared[97]; w15 = -w9; r14 = w15; r15 = w9; w17 = w17 / prepared[98]; r16 = w17; w17 = -w17; r17 = w17;
 w22 = w22 / prepared[99]; r18 = w22; w22 = -w22; r19 = w22; w23 = R(1.0) / prepared[99]; r20 = w23; w23 = -w23;
 r21 = w23; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3; g[4] = r4; g[5] = r5; by[1] = r6; by[13] = r7; by[25] = r8;
 by[37] = r9; by[49] = r10; by[61] = r11; by[4] = r12; by[16] = r13; by[5] = r14; by[17] = r15; by[29] = r16;
 by[41] = r17; by[53] = r18; by[65] = r19; by[54] = r20; by[66] = r21;
}

static void rates_bend(const real *prepared, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35; real w36, w37, w38, w39, w40, w41, w42, r0, r1;
 w1 = y[1] - prepared[44]; w1 = w1 - prepared[40]; w1 = w1 / R(2.0); w2 = V(cos)(w1); w5 = w2 * w2;
 w6 = prepared[12] * w5; w1 = V(sin)(w1); w8 = w1 * w1; w8 = prepared[13] * w8; w9 = w6 + w8; w10 = w9 * w9;
 w12 = prepared[15] * w1; w13 = w12 * w2; w14 = w13 * w13; w10 = w10 + w14; w3 = V(is)(R(0.0) < w10);
 w16 = lam[2] - lam[3]; w16 = w16 / prepared[98]; w17 = y[5] * w16; w10 = V(where)(w3 != R(0.0), w10);
 w18 = V(is)(w3 == R(0.0)); w18 = V(where)(w18 != R(0.0), R(1.0)); w10 = w10 + w18; w18 = V(sqrt)(w10); w19 = w17 / w18;
 w20 = w19 / w18; w21 = R(2.0) * w9; w22 = R(2.0) * w1; w23 = R(0.5) * w2; w24 = w22 * w23; w24 = prepared[13] * w24;
 w25 = R(2.0) * w2; w26 = R(0.5) * w1; w27 = w25 * w26; w27 = prepared[12] * w27; w28 = w24 - w27; w29 = w21 * w28;
 w13 = R(2.0) * w13; w30 = prepared[15] * w23; w31 = w2 * w30; w32 = w12 * w26; w31 = w31 - w32; w32 = w13 * w31;
 w29 = w29 + w32; w32 = R(2.0) * w18; w33 = w29 / w32; w20 = w20 * w33; w20 = prepared[16] * w20; w34 = w2 * w20;
 w34 = -w34; w34 = V(where)(w3 != R(0.0), w34); w19 = prepared[16] * w19; w35 = w19 * w26; w34 = w34 - w35;
 w34 = R(2.0) * w34; w6 = w6 - w8; w6 = prepared[14] * w6; w6 = w6 / w10; w6 = w6 / w10; w8 = lam[0] - lam[1];
 w8 = w8 / prepared[97]; w36 = y[5] * w8; w37 = w6 * w36; w9 = prepared[17] * w9; w9 = w9 / w10; w9 = w9 / w10;
 w39 = lam[4] - lam[5]; w39 = w39 / prepared[99]; w15 = y[5] * w39; w40 = w9 * w15; w41 = w22 * w2;
 w41 = prepared[16] * w41; w41 = w41 / w18; w41 = w41 / w18; w42 = w41 * w17; w42 = w42 / w32; w40 = w40 + w42;
 w37 = w37 - w40; w31 = R(2.0) * w31; w31 = w37 * w31; w40 = w6 * w29; w40 = -w40; w40 = V(where)(w3 != R(0.0), w40);
 w27 = w27 + w24; w27 = prepared[14] * w27; w27 = w27 / w10; w40 = w40 - w27; w40 = w40 / w10; w27 = w6 / w10;
 w27 = w27 * w29; w27 = -w27; w27 = V(where)(w3 != R(0.0), w27); w40 = w40 + w27; w40 = w36 * w40;
 w27 = prepared[17] * w28; w27 = w27 / w10; w24 = w9 * w29; w24 = -w24; w24 = V(where)(w3 != R(0.0), w24);
 w27 = w27 + w24; w27 = w27 / w10; w24 = w9 / w10; w24 = w24 * w29; w24 = -w24; w24 = V(where)(w3 != R(0.0), w24);
 w27 = w27 + w24; w27 = w15 * w27; w24 = w22 * w26; w5 = w5 - w24; w5 = prepared[16] * w5; w5 = w5 / w18;
 w24 = w41 * w33; w24 = -w24; w24 = V(where)(w3 != R(0.0), w24); w5 = w5 + w24; w5 = w5 / w18; w24 = w41 / w18;
 w24 = w24 * w33; w24 = -w24; w24 = V(where)(w3 != R(0.0), w24); w5 = w5 + w24; w17 = w17 * w5; w17 = w17 / w32;
 w42 = w42 / w32; w33 = R(2.0) * w33; w42 = w42 * w33; w42 = -w42; w42 = V(where)(w3 != R(0.0), w42); w17 = w17 + w42;
 w27 = w27 + w17; w40 = w40 - w27; w27 = w13 * w40; w31 = w31 + w27; w27 = w2 * w31; w17 = w13 * w37; w42 = w17 * w26;
 w27 = w27 - w42; w27 = prepared[15] * w27; w27 = V(where)(w3 != R(0.0), w27); w34 = w34 + w27; w15 = w15 / w10;
 w27 = prepared[17] * w15; w42 = w21 * w37; w42 = V(where)(w3 != R(0.0), w42); w27 = w27 + w42; w36 = w36 / w10;
 w42 = prepared[14] * w36; w33 = w27 + w42; w33 = prepared[13] * w33; w5 = w33 * w2; w28 = R(2.0) * w28;
 w37 = w37 * w28; w40 = w21 * w40; w37 = w37 + w40; w15 = w15 / w10; w15 = w15 * w29; w15 = prepared[17] * w15;
 w37 = w37 - w15; w36 = w36 / w10; w36 = w36 * w29; w36 = prepared[14] * w36; w29 = w37 - w36; w29 = prepared[13] * w29;
 w29 = w22 * w29; w29 = V(where)(w3 != R(0.0), w29); w5 = w5 + w29; w34 = w34 + w5; w34 = w2 * w34; w5 = w2 * w19;
 w5 = R(2.0) * w5; w29 = w2 * w17; w29 = prepared[15] * w29; w29 = V(where)(w3 != R(0.0), w29); w5 = w5 + w29;
 w33 = w22 * w33; w5 = w5 + w33; w5 = w5 * w26; w34 = w34 - w5; w5 = w22 * w19; w33 = w12 * w17;
 w33 = V(where)(w3 != R(0.0), w33); w5 = w5 + w33; w27 = w27 - w42; w27 = prepared[12] * w27; w42 = w25 * w27;
 w5 = w5 + w42; w5 = w5 * w23; w19 = w19 * w2; w20 = w22 * w20; w20 = -w20; w20 = V(where)(w3 != R(0.0), w20);
 w19 = w19 + w20; w17 = w17 * w30; w31 = w12 * w31; w17 = w17 + w31; w17 = V(where)(w3 != R(0.0), w17); w19 = w19 + w17;
 w26 = -w26; w26 = R(2.0) * w26; w27 = w27 * w26; w37 = w37 + w36; w37 = prepared[12] * w37; w37 = w25 * w37;
 w37 = V(where)(w3 != R(0.0), w37); w27 = w27 + w37; w19 = w19 + w27; w19 = w1 * w19; w5 = w5 + w19; w34 = w34 - w5;
 w34 = R(0.5) * w34; r0 = w34; w18 = w16 / w18; w14 = prepared[16] * w18; w18 = w2 * w14; w18 = R(2.0) * w18;
 w6 = w6 * w8; w9 = w9 * w39; w41 = w41 * w16; w41 = w41 / w32; w9 = w9 + w41; w6 = w6 - w9; w13 = w13 * w6;
 w9 = w2 * w13; w11 = prepared[15] * w9; w11 = V(where)(w3 != R(0.0), w11); w18 = w18 + w11; w39 = w39 / w10;
 w38 = prepared[17] * w39; w21 = w21 * w6; w21 = V(where)(w3 != R(0.0), w21); w38 = w38 + w21; w8 = w8 / w10;
 w35 = prepared[14] * w8; w8 = w38 + w35; w7 = prepared[13] * w8; w7 = w22 * w7; w18 = w18 + w7; w2 = w2 * w18;
 w22 = w22 * w14; w12 = w12 * w13; w3 = V(where)(w3 != R(0.0), w12); w22 = w22 + w3; w38 = w38 - w35;
 w4 = prepared[12] * w38; w25 = w25 * w4; w22 = w22 + w25; w1 = w1 * w22; w2 = w2 - w1; w0 = R(0.5) * w2; r1 = w0;
 bend[13] += r0; bend[17] += r1;
}

static void retina_at(const real *prepared, const real *y, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, r0; w1 = V(cos)(y[0]); w4 = V(cos)(y[1]); w5 = w4 * prepared[18];
 w2 = prepared[19] + w5; w5 = w1 * w2; w0 = V(sin)(y[0]); w3 = V(sin)(y[1]); w6 = w3 * prepared[35]; w7 = w0 * w6;
 w5 = w5 - w7; w5 = w5 * prepared[36]; w9 = w4 * prepared[20]; w8 = prepared[20] - w9; w9 = w1 * w8;
 w3 = w3 * prepared[34]; w10 = w0 * w3; w9 = w9 + w10; w9 = w9 * prepared[37]; w5 = w5 + w9; w5 = w5 * y[3];
 w5 = w5 - prepared[45]; w5 = w5 * w5; w2 = w0 * w2; w6 = w1 * w6; w2 = w2 + w6; w2 = w2 * prepared[36]; w0 = w0 * w8;
 w1 = w1 * w3; w0 = w0 - w1; w0 = w0 * prepared[37]; w2 = w2 + w0; w2 = w2 * y[3]; w2 = w2 - prepared[46]; w2 = w2 * w2;
 w5 = w5 + w2; w0 = w4 * prepared[21]; w2 = prepared[21] - w0; w2 = w2 * prepared[36]; w4 = w4 * prepared[22];
 w7 = prepared[23] + w4; w7 = w7 * prepared[37]; w2 = w2 + w7; w2 = w2 * y[3]; w2 = w2 - prepared[47]; w2 = w2 * w2;
 w5 = w5 + w2; w5 = w5 / prepared[24]; w5 = w5 - prepared[100]; r0 = w5; g[0] = r0;
}

static void retina_by(const real *prepared, const real *y, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, r0, r1, r2, r3; w1 = V(cos)(y[0]); w4 = V(cos)(y[1]); w6 = w4 * prepared[18];
 w2 = prepared[19] + w6; w6 = w1 * w2; w0 = V(sin)(y[0]); w3 = V(sin)(y[1]); w8 = w3 * prepared[35]; w9 = w0 * w8;
 w6 = w6 - w9; w6 = w6 * prepared[36]; w11 = w4 * prepared[20]; w11 = prepared[20] - w11; w12 = w1 * w11;
 w14 = w3 * prepared[34]; w15 = w0 * w14; w12 = w12 + w15; w12 = w12 * prepared[37]; w6 = w6 + w12; w16 = w6 * y[3];
 w16 = w16 - prepared[45]; w17 = w16 * w16; w18 = w0 * w2; w19 = w1 * w8; w18 = w18 + w19; w18 = w18 * prepared[36];
 w19 = w0 * w11; w20 = w1 * w14; w19 = w19 - w20; w19 = w19 * prepared[37]; w18 = w18 + w19; w19 = w18 * y[3];
 w19 = w19 - prepared[46]; w20 = w19 * w19; w17 = w17 + w20; w21 = w4 * prepared[21]; w21 = prepared[21] - w21;
 w21 = w21 * prepared[36]; w24 = w4 * prepared[22]; w22 = prepared[23] + w24; w22 = w22 * prepared[37]; w21 = w21 + w22;
 w22 = w21 * y[3]; w22 = w22 - prepared[47]; w24 = w22 * w22; w17 = w17 + w24; w17 = w17 / prepared[24];
 w17 = w17 - prepared[100]; r0 = w17; w19 = R(2.0) * w19; w19 = w19 / prepared[24]; w17 = y[3] * w19;
 w25 = prepared[37] * w17; w26 = w11 * w25; w17 = prepared[36] * w17; w27 = w2 * w17; w26 = w26 + w27;
 w16 = R(2.0) * w16; w16 = w16 / prepared[24]; w27 = y[3] * w16; w28 = prepared[37] * w27; w29 = w14 * w28;
 w26 = w26 + w29; w27 = prepared[36] * w27; w29 = w8 * w27; w26 = w26 - w29; w26 = w1 * w26; w8 = w8 * w17;
 w14 = w14 * w25; w8 = w8 - w14; w11 = w11 * w28; w8 = w8 + w11; w2 = w2 * w27; w8 = w8 + w2; w8 = w0 * w8;
 w26 = w26 - w8; r1 = w26; w26 = w0 * w28; w8 = w1 * w25; w26 = w26 - w8; w13 = prepared[34] * w26; w26 = w1 * w17;
 w8 = w0 * w27; w26 = w26 - w8; w7 = prepared[35] * w26; w13 = w13 + w7; w4 = w4 * w13; w22 = R(2.0) * w22;
 w22 = w22 / prepared[24]; w12 = y[3] * w22; w15 = prepared[37] * w12; w23 = prepared[22] * w15;
 w9 = prepared[36] * w12; w20 = prepared[21] * w9; w23 = w23 - w20; w25 = w0 * w25; w28 = w1 * w28; w25 = w25 + w28;
 w10 = prepared[20] * w25; w23 = w23 - w10; w0 = w0 * w17; w1 = w1 * w27; w0 = w0 + w1; w5 = prepared[18] * w0;
 w23 = w23 + w5; w3 = w3 * w23; w4 = w4 - w3; r2 = w4; w21 = w21 * w22; w18 = w18 * w19; w21 = w21 + w18; w6 = w6 * w16;
 w21 = w21 + w6; r3 = w21; g[0] = r0; by[0] = r1; by[1] = r2; by[3] = r3;
}

static void retina_bend(const real *prepared, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, r0; real r1, r2, r3, r4, r5; w1 = V(cos)(y[0]);
 w4 = V(cos)(y[1]); w5 = w4 * prepared[20]; w5 = prepared[20] - w5; w8 = lam[0] / prepared[24]; w12 = w4 * prepared[18];
 w10 = prepared[19] + w12; w12 = w10 * w1; w3 = V(sin)(y[1]); w14 = w3 * prepared[35]; w0 = V(sin)(y[0]);
 w15 = w14 * w0; w12 = w12 - w15; w12 = prepared[36] * w12; w15 = w5 * w1; w17 = w3 * prepared[34]; w18 = w17 * w0;
 w15 = w15 + w18; w15 = prepared[37] * w15; w12 = w12 + w15; w12 = y[3] * w12; w12 = R(2.0) * w12; w12 = w8 * w12;
 w12 = y[3] * w12; w15 = prepared[37] * w12; w18 = w5 * w15; w12 = prepared[36] * w12; w19 = w10 * w12; w18 = w18 + w19;
 w19 = w17 * w1; w20 = w5 * w0; w19 = w19 - w20; w19 = prepared[37] * w19; w20 = w10 * w0; w21 = w14 * w1;
 w20 = w20 + w21; w20 = prepared[36] * w20; w19 = w19 - w20; w19 = y[3] * w19; w19 = R(2.0) * w19; w19 = w8 * w19;
 w19 = y[3] * w19; w20 = prepared[37] * w19; w21 = w17 * w20; w18 = w18 + w21; w19 = prepared[36] * w19;
 w21 = w14 * w19; w18 = w18 - w21; w18 = w1 * w18; w21 = w0 * w10; w22 = w1 * w14; w21 = w21 + w22;
 w21 = w21 * prepared[36]; w22 = w0 * w5; w23 = w1 * w17; w22 = w22 - w23; w22 = w22 * prepared[37]; w21 = w21 + w22;
 w22 = w21 * y[3]; w22 = w22 - prepared[46]; w22 = R(2.0) * w22; w22 = w22 * w8; w23 = y[3] * w22;
 w24 = prepared[37] * w23; w25 = w5 * w24; w23 = prepared[36] * w23; w26 = w10 * w23; w25 = w25 + w26; w26 = w1 * w10;
 w27 = w0 * w14; w26 = w26 - w27; w26 = w26 * prepared[36]; w27 = w1 * w5; w28 = w0 * w17; w27 = w27 + w28;
 w27 = w27 * prepared[37]; w26 = w26 + w27; w27 = w26 * y[3]; w27 = w27 - prepared[45]; w27 = R(2.0) * w27;
 w27 = w27 * w8; w28 = y[3] * w27; w29 = prepared[37] * w28; w30 = w17 * w29; w25 = w25 + w30; w28 = prepared[36] * w28;
 w30 = w14 * w28; w25 = w25 - w30; w25 = w25 * w0; w18 = w18 - w25; w25 = w14 * w23; w30 = w17 * w24; w25 = w25 - w30;
 w30 = w5 * w29; w25 = w25 + w30; w30 = w10 * w28; w25 = w25 + w30; w25 = w25 * w1; w12 = w14 * w12; w15 = w17 * w15;
 w12 = w12 - w15; w20 = w5 * w20; w12 = w12 + w20; w19 = w10 * w19; w12 = w12 + w19; w12 = w0 * w12; w25 = w25 + w12;
 w18 = w18 - w25; r0 = w18; w18 = prepared[20] * w3; w25 = w24 * w18; w12 = prepared[35] * w4; w19 = w1 * w12;
 w20 = prepared[18] * w3; w15 = w0 * w20; w19 = w19 - w15; w19 = prepared[36] * w19; w15 = w0 * w18;
 w30 = prepared[34] * w4; w31 = w1 * w30; w15 = w15 - w31; w15 = prepared[37] * w15; w19 = w19 + w15; w19 = y[3] * w19;
 w19 = R(2.0) * w19; w19 = w8 * w19; w19 = y[3] * w19; w15 = prepared[37] * w19; w31 = w5 * w15; w25 = w25 + w31;
 w19 = prepared[36] * w19; w31 = w10 * w19; w32 = w23 * w20; w31 = w31 - w32; w25 = w25 + w31; w31 = w29 * w30;
 w32 = w1 * w18; w33 = w0 * w30; w32 = w32 + w33; w32 = prepared[37] * w32; w33 = w1 * w20; w34 = w0 * w12;
 w33 = w33 + w34; w33 = prepared[36] * w33; w32 = w32 - w33; w32 = y[3] * w32; w32 = R(2.0) * w32; w32 = w8 * w32;
 w32 = y[3] * w32; w33 = prepared[37] * w32; w34 = w17 * w33; w31 = w31 + w34; w25 = w25 + w31; w31 = w28 * w12;
 w32 = prepared[36] * w32; w34 = w14 * w32; w31 = w31 + w34; w25 = w25 - w31; w25 = w1 * w25; w12 = w23 * w12;
 w31 = w14 * w19; w12 = w12 + w31; w30 = w24 * w30; w31 = w17 * w15; w30 = w30 + w31; w12 = w12 - w30; w18 = w29 * w18;
 w30 = w5 * w33; w18 = w18 + w30; w12 = w12 + w18; w18 = w10 * w32; w20 = w28 * w20; w18 = w18 - w20; w12 = w12 + w18;
 w12 = w0 * w12; w25 = w25 - w12; r1 = w25; w25 = w0 * w33; w12 = w1 * w15; w25 = w25 - w12; w25 = prepared[34] * w25;
 w12 = w1 * w19; w18 = w0 * w32; w12 = w12 - w18; w12 = prepared[35] * w12; w25 = w25 + w12; w25 = w4 * w25;
 w12 = w0 * w29; w18 = w1 * w24; w12 = w12 - w18; w12 = prepared[34] * w12; w18 = w1 * w23; w20 = w0 * w28;
 w18 = w18 - w20; w18 = prepared[35] * w18; w12 = w12 + w18; w12 = w12 * w3; w25 = w25 - w12; w20 = w4 * prepared[21];
 w20 = prepared[21] - w20; w20 = w20 * prepared[36]; w31 = w4 * prepared[22]; w30 = prepared[23] + w31;
 w30 = w30 * prepared[37]; w20 = w20 + w30; w30 = w20 * y[3]; w30 = w30 - prepared[47]; w30 = R(2.0) * w30;
 w30 = w30 * w8; w31 = y[3] * w30; w34 = prepared[37] * w31; w34 = prepared[22] * w34; w31 = prepared[36] * w31;
 w31 = prepared[21] * w31; w34 = w34 - w31; w24 = w0 * w24; w29 = w1 * w29; w24 = w24 + w29; w24 = prepared[20] * w24;
 w34 = w34 - w24; w23 = w0 * w23; w28 = w1 * w28; w23 = w23 + w28; w23 = prepared[18] * w23; w34 = w34 + w23;
 w34 = w34 * w4; w23 = prepared[21] * w3; w23 = prepared[36] * w23; w28 = prepared[22] * w3; w28 = prepared[37] * w28;
 w23 = w23 - w28; w23 = y[3] * w23; w23 = R(2.0) * w23; w23 = w8 * w23; w23 = y[3] * w23; w28 = prepared[37] * w23;
 w28 = prepared[22] * w28; w23 = prepared[36] * w23; w23 = prepared[21] * w23; w28 = w28 - w23; w15 = w0 * w15;
 w33 = w1 * w33; w15 = w15 + w33; w15 = prepared[20] * w15; w28 = w28 - w15; w19 = w0 * w19; w32 = w1 * w32;
 w19 = w19 + w32; w19 = prepared[18] * w19; w28 = w28 + w19; w28 = w3 * w28; w34 = w34 + w28; w25 = w25 - w34; r2 = w25;
 w25 = R(2.0) * w21; w25 = w8 * w25; w34 = y[3] * w25; w22 = w22 + w34; w34 = prepared[37] * w22; w28 = w5 * w34;
 w22 = prepared[36] * w22; w19 = w10 * w22; w28 = w28 + w19; w19 = R(2.0) * w26; w19 = w8 * w19; w32 = y[3] * w19;
 w27 = w27 + w32; w32 = prepared[37] * w27; w15 = w17 * w32; w28 = w28 + w15; w27 = prepared[36] * w27; w15 = w14 * w27;
 w28 = w28 - w15; w28 = w1 * w28; w14 = w14 * w22; w17 = w17 * w34; w14 = w14 - w17; w5 = w5 * w32; w14 = w14 + w5;
 w10 = w10 * w27; w14 = w14 + w10; w14 = w0 * w14; w28 = w28 - w14; r3 = w28; w28 = w0 * w32; w14 = w1 * w34;
 w28 = w28 - w14; w16 = prepared[34] * w28; w28 = w1 * w22; w14 = w0 * w27; w28 = w28 - w14; w13 = prepared[35] * w28;
 w16 = w16 + w13; w4 = w4 * w16; w16 = R(2.0) * w20; w8 = w8 * w16; w7 = y[3] * w8; w30 = w30 + w7;
 w6 = prepared[37] * w30; w12 = prepared[22] * w6; w9 = prepared[36] * w30; w18 = prepared[21] * w9; w12 = w12 - w18;
 w34 = w0 * w34; w32 = w1 * w32; w34 = w34 + w32; w2 = prepared[20] * w34; w12 = w12 - w2; w0 = w0 * w22; w1 = w1 * w27;
 w0 = w0 + w1; w11 = prepared[18] * w0; w12 = w12 + w11; w3 = w3 * w12; w4 = w4 - w3; r4 = w4; w20 = w20 * w8;
 w21 = w21 * w25; w20 = w20 + w21; w26 = w26 * w19; w20 = w20 + w26; r5 = w20; bend[0] += r0; bend[1] += r1;
 bend[13] += r2; bend[3] += r3; bend[15] += r4; bend[39] += r5;
}

static void lens_at(const real *prepared, const real *y, real *restrict g)
{
 real w1, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12, w13; real w14, w15, r0; w5 = V(cos)(y[0]); w8 = V(cos)(y[1]);
 w9 = w8 * prepared[25]; w6 = prepared[26] + w9; w9 = w5 * w6; w4 = V(sin)(y[0]); w7 = V(sin)(y[1]);
 w10 = w7 * prepared[35]; w11 = w4 * w10; w9 = w9 - w11; w9 = w9 * prepared[36]; w13 = w8 * prepared[27];
 w12 = prepared[27] - w13; w13 = w5 * w12; w7 = w7 * prepared[34]; w14 = w4 * w7; w13 = w13 + w14;
 w13 = w13 * prepared[37]; w9 = w9 + w13; w9 = w9 * y[3]; w3 = prepared[54] * w9; w6 = w4 * w6; w10 = w5 * w10;
 w6 = w6 + w10; w6 = w6 * prepared[36]; w4 = w4 * w12; w5 = w5 * w7; w4 = w4 - w5; w4 = w4 * prepared[37]; w6 = w6 + w4;
 w6 = w6 * y[3]; w15 = prepared[57] * w6; w3 = w3 + w15; w5 = w8 * prepared[28]; w4 = prepared[28] - w5;
 w4 = w4 * prepared[36]; w8 = w8 * prepared[29]; w11 = prepared[30] + w8; w11 = w11 * prepared[37]; w4 = w4 + w11;
 w4 = w4 * y[3]; w15 = prepared[60] * w4; w3 = w3 + w15; w15 = prepared[31] * w3; w11 = prepared[55] * w9;
 w14 = prepared[58] * w6; w11 = w11 + w14; w14 = prepared[61] * w4; w11 = w11 + w14; w14 = prepared[32] * w11;
 w15 = w15 + w14; w8 = prepared[56] * w9; w9 = prepared[59] * w6; w8 = w8 + w9; w9 = prepared[62] * w4; w8 = w8 + w9;
 w9 = prepared[33] * w8; w15 = w15 + w9; w4 = w3 * w3; w6 = w11 * w11; w4 = w4 + w6; w6 = w8 * w8; w4 = w4 + w6;
 w9 = V(is)(R(1e-12) < w4); w4 = V(where)(w9 != R(0.0), w4); w9 = V(is)(w9 == R(0.0));
 w9 = V(where)(w9 != R(0.0), R(1.0)); w4 = w4 + w9; w15 = w15 / w4; w1 = V(is)(R(0.0) < w15); w4 = V(is)(w15 < R(1.0));
 w15 = V(where)(w4 != R(0.0), w15); w4 = V(is)(w4 == R(0.0)); w4 = V(where)(w4 != R(0.0), R(1.0)); w15 = w15 + w4;
 w3 = w15 * w3; w3 = V(where)(w1 != R(0.0), w3); w3 = w3 - prepared[31]; w3 = w3 * w3; w11 = w15 * w11;
 w11 = V(where)(w1 != R(0.0), w11); w11 = w11 - prepared[32]; w11 = w11 * w11; w3 = w3 + w11; w15 = w15 * w8;
 w1 = V(where)(w1 != R(0.0), w15); w1 = w1 - prepared[33]; w1 = w1 * w1; w3 = w3 + w1; w3 = R(1.0) - w3;
 w3 = w3 + R(1.0); r0 = w3; g[0] = r0;
}

static void lens_by(const real *prepared, const real *y, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35;
 real w36, w37, w38, w39, w40, w41, w42, w43, w44, w45, w46, r0; real r1, r2, r3; w5 = V(cos)(y[0]); w8 = V(cos)(y[1]);
 w10 = w8 * prepared[25]; w6 = prepared[26] + w10; w10 = w5 * w6; w4 = V(sin)(y[0]); w7 = V(sin)(y[1]);
 w12 = w7 * prepared[35]; w13 = w4 * w12; w10 = w10 - w13; w10 = w10 * prepared[36]; w15 = w8 * prepared[27];
 w15 = prepared[27] - w15; w16 = w5 * w15; w18 = w7 * prepared[34]; w19 = w4 * w18; w16 = w16 + w19;
 w16 = w16 * prepared[37]; w10 = w10 + w16; w20 = w10 * y[3]; w21 = prepared[54] * w20; w23 = w4 * w6; w24 = w5 * w12;
 w23 = w23 + w24; w23 = w23 * prepared[36]; w24 = w4 * w15; w25 = w5 * w18; w24 = w24 - w25; w24 = w24 * prepared[37];
 w23 = w23 + w24; w24 = w23 * y[3]; w25 = prepared[57] * w24; w21 = w21 + w25; w27 = w8 * prepared[28];
 w27 = prepared[28] - w27; w27 = w27 * prepared[36]; w30 = w8 * prepared[29]; w28 = prepared[30] + w30;
 w28 = w28 * prepared[37]; w27 = w27 + w28; w28 = w27 * y[3]; w30 = prepared[60] * w28; w21 = w21 + w30;
 w30 = prepared[31] * w21; w33 = prepared[55] * w20; w35 = prepared[58] * w24; w33 = w33 + w35;
 w36 = prepared[61] * w28; w33 = w33 + w36; w36 = prepared[32] * w33; w30 = w30 + w36; w20 = prepared[56] * w20;
 w24 = prepared[59] * w24; w20 = w20 + w24; w28 = prepared[62] * w28; w20 = w20 + w28; w28 = prepared[33] * w20;
 w30 = w30 + w28; w39 = w21 * w21; w40 = w33 * w33; w39 = w39 + w40; w40 = w20 * w20; w39 = w39 + w40;
 w28 = V(is)(R(1e-12) < w39); w39 = V(where)(w28 != R(0.0), w39); w40 = V(is)(w28 == R(0.0));
 w40 = V(where)(w40 != R(0.0), R(1.0)); w39 = w39 + w40; w30 = w30 / w39; w1 = V(is)(R(0.0) < w30);
 w40 = V(is)(w30 < R(1.0)); w41 = V(where)(w40 != R(0.0), w30); w42 = V(is)(w40 == R(0.0));
 w42 = V(where)(w42 != R(0.0), R(1.0)); w41 = w41 + w42; w42 = w41 * w21; w42 = V(where)(w1 != R(0.0), w42);
 w42 = w42 - prepared[31]; w43 = w42 * w42; w44 = w41 * w33; w44 = V(where)(w1 != R(0.0), w44);
 w44 = w44 - prepared[32]; w45 = w44 * w44; w43 = w43 + w45; w45 = w41 * w20; w45 = V(where)(w1 != R(0.0), w45);
 w45 = w45 - prepared[33]; w46 = w45 * w45; w43 = w43 + w46; w43 = R(1.0) - w43; w43 = w43 + R(1.0); r0 = w43;
 w45 = R(2.0) * w45; w43 = w41 * w45; w43 = -w43; w43 = V(where)(w1 != R(0.0), w43); w0 = R(2.0) * w20; w30 = w30 / w39;
 w20 = w20 * w45; w44 = R(2.0) * w44; w45 = w33 * w44; w20 = w20 + w45; w42 = R(2.0) * w42; w45 = w21 * w42;
 w20 = w20 + w45; w30 = w30 * w20; w0 = w0 * w30; w0 = V(where)(w1 != R(0.0), w0); w0 = V(where)(w40 != R(0.0), w0);
 w0 = V(where)(w28 != R(0.0), w0); w43 = w43 + w0; w20 = w20 / w39; w36 = prepared[33] * w20; w36 = -w36;
 w36 = V(where)(w1 != R(0.0), w36); w36 = V(where)(w40 != R(0.0), w36); w43 = w43 + w36; w38 = prepared[59] * w43;
 w44 = w41 * w44; w44 = -w44; w44 = V(where)(w1 != R(0.0), w44); w33 = R(2.0) * w33; w33 = w33 * w30;
 w33 = V(where)(w1 != R(0.0), w33); w33 = V(where)(w40 != R(0.0), w33); w33 = V(where)(w28 != R(0.0), w33);
 w44 = w44 + w33; w31 = prepared[32] * w20; w31 = -w31; w31 = V(where)(w1 != R(0.0), w31);
 w31 = V(where)(w40 != R(0.0), w31); w44 = w44 + w31; w34 = prepared[58] * w44; w38 = w38 + w34; w41 = w41 * w42;
 w41 = -w41; w41 = V(where)(w1 != R(0.0), w41); w21 = R(2.0) * w21; w21 = w21 * w30; w21 = V(where)(w1 != R(0.0), w21);
 w21 = V(where)(w40 != R(0.0), w21); w28 = V(where)(w28 != R(0.0), w21); w41 = w41 + w28; w2 = prepared[31] * w20;
 w2 = -w2; w1 = V(where)(w1 != R(0.0), w2); w40 = V(where)(w40 != R(0.0), w1); w41 = w41 + w40;
 w22 = prepared[57] * w41; w38 = w38 + w22; w22 = y[3] * w38; w40 = prepared[37] * w22; w1 = w15 * w40;
 w22 = prepared[36] * w22; w2 = w6 * w22; w1 = w1 + w2; w37 = prepared[56] * w43; w32 = prepared[55] * w44;
 w37 = w37 + w32; w3 = prepared[54] * w41; w37 = w37 + w3; w3 = y[3] * w37; w32 = prepared[37] * w3; w2 = w18 * w32;
 w1 = w1 + w2; w3 = prepared[36] * w3; w2 = w12 * w3; w1 = w1 - w2; w1 = w5 * w1; w12 = w12 * w22; w18 = w18 * w40;
 w12 = w12 - w18; w15 = w15 * w32; w12 = w12 + w15; w6 = w6 * w3; w12 = w12 + w6; w12 = w4 * w12; w1 = w1 - w12;
 r1 = w1; w1 = w4 * w32; w12 = w5 * w40; w1 = w1 - w12; w17 = prepared[34] * w1; w1 = w5 * w22; w12 = w4 * w3;
 w1 = w1 - w12; w11 = prepared[35] * w1; w17 = w17 + w11; w8 = w8 * w17; w24 = prepared[62] * w43;
 w35 = prepared[61] * w44; w24 = w24 + w35; w25 = prepared[60] * w41; w24 = w24 + w25; w16 = y[3] * w24;
 w19 = prepared[37] * w16; w29 = prepared[29] * w19; w13 = prepared[36] * w16; w26 = prepared[28] * w13;
 w29 = w29 - w26; w40 = w4 * w40; w32 = w5 * w32; w40 = w40 + w32; w14 = prepared[27] * w40; w29 = w29 - w14;
 w4 = w4 * w22; w5 = w5 * w3; w4 = w4 + w5; w9 = prepared[25] * w4; w29 = w29 + w9; w7 = w7 * w29; w8 = w8 - w7;
 r2 = w8; w27 = w27 * w24; w23 = w23 * w38; w27 = w27 + w23; w10 = w10 * w37; w27 = w27 + w10; r3 = w27; g[0] = r0;
 by[0] = r1; by[1] = r2; by[3] = r3;
}

static void lens_bend(const real *prepared, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35;
 real w36, w37, w38, w39, w40, w41, w42, w43, w44, w45, w46, w47;
 real w48, w49, w50, w51, w52, w53, w54, w55, w56, w57, w58, w59;
 real w60, w61, w62, w63, w64, w65, w66, w67, w68, w69, w70, w71;
 real w72, w73, w74, w75, w76, w77, r0, r1, r2, r3, r4, r5; w1 = V(cos)(y[0]); w4 = V(cos)(y[1]);
 w5 = w4 * prepared[27]; w5 = prepared[27] - w5; w14 = w4 * prepared[25]; w12 = prepared[26] + w14; w14 = w1 * w12;
 w0 = V(sin)(y[0]); w3 = V(sin)(y[1]); w16 = w3 * prepared[35]; w17 = w0 * w16; w14 = w14 - w17;
 w14 = w14 * prepared[36]; w18 = w1 * w5; w20 = w3 * prepared[34]; w21 = w0 * w20; w18 = w18 + w21;
 w18 = w18 * prepared[37]; w14 = w14 + w18; w18 = w14 * y[3]; w21 = prepared[54] * w18; w23 = w0 * w12; w24 = w1 * w16;
 w23 = w23 + w24; w23 = w23 * prepared[36]; w24 = w0 * w5; w25 = w1 * w20; w24 = w24 - w25; w24 = w24 * prepared[37];
 w23 = w23 + w24; w24 = w23 * y[3]; w25 = prepared[57] * w24; w21 = w21 + w25; w27 = w4 * prepared[28];
 w27 = prepared[28] - w27; w27 = w27 * prepared[36]; w30 = w4 * prepared[29]; w28 = prepared[30] + w30;
 w28 = w28 * prepared[37]; w27 = w27 + w28; w28 = w27 * y[3]; w30 = prepared[60] * w28; w21 = w21 + w30;
 w30 = prepared[31] * w21; w33 = prepared[55] * w18; w35 = prepared[58] * w24; w33 = w33 + w35;
 w36 = prepared[61] * w28; w33 = w33 + w36; w36 = prepared[32] * w33; w30 = w30 + w36; w18 = prepared[56] * w18;
 w24 = prepared[59] * w24; w18 = w18 + w24; w28 = prepared[62] * w28; w18 = w18 + w28; w28 = prepared[33] * w18;
 w30 = w30 + w28; w38 = w21 * w21; w39 = w33 * w33; w38 = w38 + w39; w39 = w18 * w18; w38 = w38 + w39;
 w28 = V(is)(R(1e-12) < w38); w38 = V(where)(w28 != R(0.0), w38); w39 = V(is)(w28 == R(0.0));
 w39 = V(where)(w39 != R(0.0), R(1.0)); w38 = w38 + w39; w30 = w30 / w38; w9 = V(is)(R(0.0) < w30);
 w39 = V(is)(w30 < R(1.0)); w41 = V(where)(w39 != R(0.0), w30); w42 = V(is)(w39 == R(0.0));
 w42 = V(where)(w42 != R(0.0), R(1.0)); w41 = w41 + w42; w42 = w41 * w18; w42 = V(where)(w9 != R(0.0), w42);
 w42 = w42 - prepared[33]; w42 = R(2.0) * w42; w42 = w42 * lam[0]; w43 = w20 * w1; w44 = w5 * w0; w43 = w43 - w44;
 w43 = prepared[37] * w43; w44 = w12 * w0; w45 = w16 * w1; w44 = w44 + w45; w44 = prepared[36] * w44; w43 = w43 - w44;
 w43 = y[3] * w43; w44 = prepared[54] * w43; w45 = w12 * w1; w46 = w16 * w0; w45 = w45 - w46; w45 = prepared[36] * w45;
 w46 = w5 * w1; w47 = w20 * w0; w46 = w46 + w47; w46 = prepared[37] * w46; w45 = w45 + w46; w45 = y[3] * w45;
 w46 = prepared[57] * w45; w44 = w44 + w46; w46 = prepared[31] * w44; w47 = prepared[55] * w43;
 w48 = prepared[58] * w45; w47 = w47 + w48; w48 = prepared[32] * w47; w46 = w46 + w48; w43 = prepared[56] * w43;
 w45 = prepared[59] * w45; w43 = w43 + w45; w45 = prepared[33] * w43; w46 = w46 + w45; w46 = w46 / w38; w30 = w30 / w38;
 w45 = R(2.0) * w21; w48 = w45 * w44; w49 = R(2.0) * w33; w50 = w49 * w47; w48 = w48 + w50; w50 = R(2.0) * w18;
 w51 = w50 * w43; w48 = w48 + w51; w51 = w30 * w48; w51 = -w51; w51 = V(where)(w28 != R(0.0), w51); w46 = w46 + w51;
 w51 = w42 * w46; w51 = V(where)(w39 != R(0.0), w51); w52 = w18 * w46; w52 = V(where)(w39 != R(0.0), w52);
 w53 = w41 * w43; w52 = w52 + w53; w52 = R(2.0) * w52; w52 = lam[0] * w52; w53 = w41 * w52;
 w53 = V(where)(w9 != R(0.0), w53); w51 = w51 + w53; w51 = -w51; w51 = V(where)(w9 != R(0.0), w51); w53 = w18 * w42;
 w54 = w41 * w33; w54 = V(where)(w9 != R(0.0), w54); w54 = w54 - prepared[32]; w54 = R(2.0) * w54; w54 = w54 * lam[0];
 w55 = w33 * w54; w53 = w53 + w55; w55 = w41 * w21; w55 = V(where)(w9 != R(0.0), w55); w55 = w55 - prepared[31];
 w55 = R(2.0) * w55; w55 = w55 * lam[0]; w56 = w21 * w55; w53 = w53 + w56; w56 = w30 * w53; w57 = R(2.0) * w43;
 w57 = w56 * w57; w58 = w46 / w38; w59 = w30 / w38; w60 = w59 * w48; w60 = -w60; w60 = V(where)(w28 != R(0.0), w60);
 w58 = w58 + w60; w58 = w53 * w58; w43 = w42 * w43; w52 = w18 * w52; w52 = V(where)(w9 != R(0.0), w52); w43 = w43 + w52;
 w52 = w54 * w47; w60 = w33 * w46; w60 = V(where)(w39 != R(0.0), w60); w61 = w41 * w47; w60 = w60 + w61;
 w60 = R(2.0) * w60; w60 = lam[0] * w60; w61 = w33 * w60; w61 = V(where)(w9 != R(0.0), w61); w52 = w52 + w61;
 w43 = w43 + w52; w52 = w55 * w44; w61 = w21 * w46; w61 = V(where)(w39 != R(0.0), w61); w62 = w41 * w44;
 w61 = w61 + w62; w61 = R(2.0) * w61; w61 = lam[0] * w61; w62 = w21 * w61; w62 = V(where)(w9 != R(0.0), w62);
 w52 = w52 + w62; w43 = w43 + w52; w52 = w30 * w43; w58 = w58 + w52; w52 = w50 * w58; w57 = w57 + w52;
 w57 = V(where)(w9 != R(0.0), w57); w57 = V(where)(w39 != R(0.0), w57); w57 = V(where)(w28 != R(0.0), w57);
 w51 = w51 + w57; w43 = w43 / w38; w57 = w53 / w38; w52 = w57 / w38; w48 = w52 * w48; w48 = -w48;
 w48 = V(where)(w28 != R(0.0), w48); w43 = w43 + w48; w48 = prepared[33] * w43; w48 = -w48;
 w48 = V(where)(w9 != R(0.0), w48); w48 = V(where)(w39 != R(0.0), w48); w51 = w51 + w48; w48 = prepared[59] * w51;
 w62 = w54 * w46; w62 = V(where)(w39 != R(0.0), w62); w60 = w41 * w60; w60 = V(where)(w9 != R(0.0), w60);
 w62 = w62 + w60; w62 = -w62; w62 = V(where)(w9 != R(0.0), w62); w47 = R(2.0) * w47; w47 = w56 * w47; w60 = w49 * w58;
 w47 = w47 + w60; w47 = V(where)(w9 != R(0.0), w47); w47 = V(where)(w39 != R(0.0), w47);
 w47 = V(where)(w28 != R(0.0), w47); w62 = w62 + w47; w47 = prepared[32] * w43; w47 = -w47;
 w47 = V(where)(w9 != R(0.0), w47); w47 = V(where)(w39 != R(0.0), w47); w62 = w62 + w47; w47 = prepared[58] * w62;
 w48 = w48 + w47; w46 = w55 * w46; w46 = V(where)(w39 != R(0.0), w46); w61 = w41 * w61;
 w61 = V(where)(w9 != R(0.0), w61); w46 = w46 + w61; w46 = -w46; w46 = V(where)(w9 != R(0.0), w46); w44 = R(2.0) * w44;
 w44 = w56 * w44; w58 = w45 * w58; w44 = w44 + w58; w44 = V(where)(w9 != R(0.0), w44);
 w44 = V(where)(w39 != R(0.0), w44); w44 = V(where)(w28 != R(0.0), w44); w46 = w46 + w44; w43 = prepared[31] * w43;
 w43 = -w43; w43 = V(where)(w9 != R(0.0), w43); w43 = V(where)(w39 != R(0.0), w43); w46 = w46 + w43;
 w43 = prepared[57] * w46; w48 = w48 + w43; w48 = y[3] * w48; w43 = prepared[37] * w48; w44 = w5 * w43;
 w48 = prepared[36] * w48; w58 = w12 * w48; w44 = w44 + w58; w51 = prepared[56] * w51; w62 = prepared[55] * w62;
 w51 = w51 + w62; w46 = prepared[54] * w46; w51 = w51 + w46; w51 = y[3] * w51; w46 = prepared[37] * w51;
 w62 = w20 * w46; w44 = w44 + w62; w51 = prepared[36] * w51; w62 = w16 * w51; w44 = w44 - w62; w44 = w1 * w44;
 w62 = w41 * w42; w62 = -w62; w62 = V(where)(w9 != R(0.0), w62); w58 = w50 * w56; w58 = V(where)(w9 != R(0.0), w58);
 w58 = V(where)(w39 != R(0.0), w58); w58 = V(where)(w28 != R(0.0), w58); w62 = w62 + w58; w58 = prepared[33] * w57;
 w58 = -w58; w58 = V(where)(w9 != R(0.0), w58); w58 = V(where)(w39 != R(0.0), w58); w62 = w62 + w58;
 w58 = prepared[59] * w62; w61 = w41 * w54; w61 = -w61; w61 = V(where)(w9 != R(0.0), w61); w47 = w49 * w56;
 w47 = V(where)(w9 != R(0.0), w47); w47 = V(where)(w39 != R(0.0), w47); w47 = V(where)(w28 != R(0.0), w47);
 w61 = w61 + w47; w47 = prepared[32] * w57; w47 = -w47; w47 = V(where)(w9 != R(0.0), w47);
 w47 = V(where)(w39 != R(0.0), w47); w61 = w61 + w47; w47 = prepared[58] * w61; w58 = w58 + w47; w47 = w41 * w55;
 w47 = -w47; w47 = V(where)(w9 != R(0.0), w47); w60 = w45 * w56; w60 = V(where)(w9 != R(0.0), w60);
 w60 = V(where)(w39 != R(0.0), w60); w60 = V(where)(w28 != R(0.0), w60); w47 = w47 + w60; w57 = prepared[31] * w57;
 w57 = -w57; w57 = V(where)(w9 != R(0.0), w57); w57 = V(where)(w39 != R(0.0), w57); w47 = w47 + w57;
 w57 = prepared[57] * w47; w58 = w58 + w57; w57 = y[3] * w58; w60 = prepared[37] * w57; w63 = w5 * w60;
 w57 = prepared[36] * w57; w64 = w12 * w57; w63 = w63 + w64; w64 = prepared[56] * w62; w65 = prepared[55] * w61;
 w64 = w64 + w65; w65 = prepared[54] * w47; w64 = w64 + w65; w65 = y[3] * w64; w66 = prepared[37] * w65;
 w67 = w20 * w66; w63 = w63 + w67; w65 = prepared[36] * w65; w67 = w16 * w65; w63 = w63 - w67; w63 = w63 * w0;
 w44 = w44 - w63; w63 = w16 * w57; w67 = w20 * w60; w63 = w63 - w67; w67 = w5 * w66; w63 = w63 + w67; w67 = w12 * w65;
 w63 = w63 + w67; w63 = w63 * w1; w48 = w16 * w48; w43 = w20 * w43; w48 = w48 - w43; w46 = w5 * w46; w48 = w48 + w46;
 w51 = w12 * w51; w48 = w48 + w51; w48 = w0 * w48; w63 = w63 + w48; w44 = w44 - w63; r0 = w44; w44 = prepared[27] * w3;
 w63 = w60 * w44; w48 = w1 * w44; w51 = prepared[34] * w4; w46 = w0 * w51; w48 = w48 + w46; w48 = prepared[37] * w48;
 w46 = prepared[25] * w3; w43 = w1 * w46; w67 = prepared[35] * w4; w68 = w0 * w67; w43 = w43 + w68;
 w43 = prepared[36] * w43; w48 = w48 - w43; w48 = y[3] * w48; w43 = prepared[54] * w48; w68 = w1 * w67; w69 = w0 * w46;
 w68 = w68 - w69; w68 = prepared[36] * w68; w69 = w0 * w44; w70 = w1 * w51; w69 = w69 - w70; w69 = prepared[37] * w69;
 w68 = w68 + w69; w68 = y[3] * w68; w69 = prepared[57] * w68; w43 = w43 + w69; w69 = prepared[28] * w3;
 w69 = prepared[36] * w69; w70 = prepared[29] * w3; w70 = prepared[37] * w70; w69 = w69 - w70; w69 = y[3] * w69;
 w70 = prepared[60] * w69; w43 = w43 + w70; w70 = prepared[31] * w43; w71 = prepared[55] * w48;
 w72 = prepared[58] * w68; w71 = w71 + w72; w72 = prepared[61] * w69; w71 = w71 + w72; w72 = prepared[32] * w71;
 w70 = w70 + w72; w48 = prepared[56] * w48; w68 = prepared[59] * w68; w48 = w48 + w68; w69 = prepared[62] * w69;
 w48 = w48 + w69; w69 = prepared[33] * w48; w70 = w70 + w69; w70 = w70 / w38; w69 = w45 * w43; w68 = w49 * w71;
 w69 = w69 + w68; w68 = w50 * w48; w69 = w69 + w68; w68 = w30 * w69; w68 = -w68; w68 = V(where)(w28 != R(0.0), w68);
 w70 = w70 + w68; w68 = w42 * w70; w68 = V(where)(w39 != R(0.0), w68); w72 = w18 * w70;
 w72 = V(where)(w39 != R(0.0), w72); w73 = w41 * w48; w72 = w72 + w73; w72 = R(2.0) * w72; w72 = lam[0] * w72;
 w73 = w41 * w72; w73 = V(where)(w9 != R(0.0), w73); w68 = w68 + w73; w68 = -w68; w68 = V(where)(w9 != R(0.0), w68);
 w73 = R(2.0) * w48; w73 = w56 * w73; w74 = w70 / w38; w75 = w59 * w69; w75 = -w75; w75 = V(where)(w28 != R(0.0), w75);
 w74 = w74 + w75; w74 = w53 * w74; w48 = w42 * w48; w72 = w18 * w72; w72 = V(where)(w9 != R(0.0), w72); w48 = w48 + w72;
 w72 = w54 * w71; w75 = w33 * w70; w75 = V(where)(w39 != R(0.0), w75); w76 = w41 * w71; w75 = w75 + w76;
 w75 = R(2.0) * w75; w75 = lam[0] * w75; w76 = w33 * w75; w76 = V(where)(w9 != R(0.0), w76); w72 = w72 + w76;
 w48 = w48 + w72; w72 = w55 * w43; w76 = w21 * w70; w76 = V(where)(w39 != R(0.0), w76); w77 = w41 * w43;
 w76 = w76 + w77; w76 = R(2.0) * w76; w76 = lam[0] * w76; w77 = w21 * w76; w77 = V(where)(w9 != R(0.0), w77);
 w72 = w72 + w77; w48 = w48 + w72; w72 = w30 * w48; w74 = w74 + w72; w72 = w50 * w74; w73 = w73 + w72;
 w73 = V(where)(w9 != R(0.0), w73); w73 = V(where)(w39 != R(0.0), w73); w73 = V(where)(w28 != R(0.0), w73);
 w68 = w68 + w73; w48 = w48 / w38; w69 = w52 * w69; w69 = -w69; w69 = V(where)(w28 != R(0.0), w69); w48 = w48 + w69;
 w69 = prepared[33] * w48; w69 = -w69; w69 = V(where)(w9 != R(0.0), w69); w69 = V(where)(w39 != R(0.0), w69);
 w68 = w68 + w69; w69 = prepared[59] * w68; w73 = w54 * w70; w73 = V(where)(w39 != R(0.0), w73); w75 = w41 * w75;
 w75 = V(where)(w9 != R(0.0), w75); w73 = w73 + w75; w73 = -w73; w73 = V(where)(w9 != R(0.0), w73); w71 = R(2.0) * w71;
 w71 = w56 * w71; w75 = w49 * w74; w71 = w71 + w75; w71 = V(where)(w9 != R(0.0), w71);
 w71 = V(where)(w39 != R(0.0), w71); w71 = V(where)(w28 != R(0.0), w71); w73 = w73 + w71; w71 = prepared[32] * w48;
 w71 = -w71; w71 = V(where)(w9 != R(0.0), w71); w71 = V(where)(w39 != R(0.0), w71); w73 = w73 + w71;
 w71 = prepared[58] * w73; w69 = w69 + w71; w70 = w55 * w70; w70 = V(where)(w39 != R(0.0), w70); w76 = w41 * w76;
 w76 = V(where)(w9 != R(0.0), w76); w70 = w70 + w76; w70 = -w70; w70 = V(where)(w9 != R(0.0), w70); w43 = R(2.0) * w43;
 w43 = w56 * w43; w74 = w45 * w74; w43 = w43 + w74; w43 = V(where)(w9 != R(0.0), w43);
 w43 = V(where)(w39 != R(0.0), w43); w43 = V(where)(w28 != R(0.0), w43); w70 = w70 + w43; w48 = prepared[31] * w48;
 w48 = -w48; w48 = V(where)(w9 != R(0.0), w48); w48 = V(where)(w39 != R(0.0), w48); w70 = w70 + w48;
 w48 = prepared[57] * w70; w69 = w69 + w48; w69 = y[3] * w69; w48 = prepared[37] * w69; w43 = w5 * w48; w63 = w63 + w43;
 w69 = prepared[36] * w69; w43 = w12 * w69; w74 = w57 * w46; w43 = w43 - w74; w63 = w63 + w43; w43 = w66 * w51;
 w74 = prepared[56] * w68; w76 = prepared[55] * w73; w74 = w74 + w76; w76 = prepared[54] * w70; w74 = w74 + w76;
 w74 = y[3] * w74; w76 = prepared[37] * w74; w71 = w20 * w76; w43 = w43 + w71; w63 = w63 + w43; w43 = w65 * w67;
 w74 = prepared[36] * w74; w71 = w16 * w74; w43 = w43 + w71; w63 = w63 - w43; w63 = w1 * w63; w67 = w57 * w67;
 w43 = w16 * w69; w67 = w67 + w43; w51 = w60 * w51; w43 = w20 * w48; w51 = w51 + w43; w67 = w67 - w51; w44 = w66 * w44;
 w51 = w5 * w76; w44 = w44 + w51; w67 = w67 + w44; w44 = w12 * w74; w46 = w65 * w46; w44 = w44 - w46; w67 = w67 + w44;
 w67 = w0 * w67; w63 = w63 - w67; r1 = w63; w63 = w0 * w76; w67 = w1 * w48; w63 = w63 - w67; w63 = prepared[34] * w63;
 w67 = w1 * w69; w44 = w0 * w74; w67 = w67 - w44; w67 = prepared[35] * w67; w63 = w63 + w67; w63 = w4 * w63;
 w67 = w0 * w66; w44 = w1 * w60; w67 = w67 - w44; w67 = prepared[34] * w67; w44 = w1 * w57; w46 = w0 * w65;
 w44 = w44 - w46; w44 = prepared[35] * w44; w67 = w67 + w44; w67 = w67 * w3; w63 = w63 - w67; w62 = prepared[62] * w62;
 w61 = prepared[61] * w61; w62 = w62 + w61; w47 = prepared[60] * w47; w62 = w62 + w47; w47 = y[3] * w62;
 w61 = prepared[37] * w47; w61 = prepared[29] * w61; w47 = prepared[36] * w47; w47 = prepared[28] * w47;
 w61 = w61 - w47; w60 = w0 * w60; w66 = w1 * w66; w60 = w60 + w66; w60 = prepared[27] * w60; w61 = w61 - w60;
 w57 = w0 * w57; w65 = w1 * w65; w57 = w57 + w65; w57 = prepared[25] * w57; w61 = w61 + w57; w61 = w61 * w4;
 w68 = prepared[62] * w68; w73 = prepared[61] * w73; w68 = w68 + w73; w70 = prepared[60] * w70; w68 = w68 + w70;
 w68 = y[3] * w68; w70 = prepared[37] * w68; w70 = prepared[29] * w70; w68 = prepared[36] * w68;
 w68 = prepared[28] * w68; w70 = w70 - w68; w48 = w0 * w48; w76 = w1 * w76; w48 = w48 + w76; w48 = prepared[27] * w48;
 w70 = w70 - w48; w69 = w0 * w69; w74 = w1 * w74; w69 = w69 + w74; w69 = prepared[25] * w69; w70 = w70 + w69;
 w70 = w3 * w70; w61 = w61 + w70; w63 = w63 - w61; r2 = w63; w63 = prepared[54] * w14; w61 = prepared[57] * w23;
 w63 = w63 + w61; w61 = prepared[60] * w27; w63 = w63 + w61; w61 = prepared[31] * w63; w70 = prepared[55] * w14;
 w69 = prepared[58] * w23; w70 = w70 + w69; w69 = prepared[61] * w27; w70 = w70 + w69; w69 = prepared[32] * w70;
 w61 = w61 + w69; w69 = prepared[56] * w14; w74 = prepared[59] * w23; w69 = w69 + w74; w74 = prepared[62] * w27;
 w69 = w69 + w74; w74 = prepared[33] * w69; w61 = w61 + w74; w61 = w61 / w38; w74 = w45 * w63; w48 = w49 * w70;
 w74 = w74 + w48; w48 = w50 * w69; w74 = w74 + w48; w48 = w30 * w74; w48 = -w48; w48 = V(where)(w28 != R(0.0), w48);
 w61 = w61 + w48; w48 = w42 * w61; w48 = V(where)(w39 != R(0.0), w48); w76 = w18 * w61;
 w76 = V(where)(w39 != R(0.0), w76); w68 = w41 * w69; w76 = w76 + w68; w76 = R(2.0) * w76; w76 = lam[0] * w76;
 w68 = w41 * w76; w68 = V(where)(w9 != R(0.0), w68); w48 = w48 + w68; w48 = -w48; w48 = V(where)(w9 != R(0.0), w48);
 w68 = R(2.0) * w69; w68 = w56 * w68; w73 = w61 / w38; w59 = w59 * w74; w59 = -w59; w59 = V(where)(w28 != R(0.0), w59);
 w73 = w73 + w59; w53 = w53 * w73; w42 = w42 * w69; w18 = w18 * w76; w18 = V(where)(w9 != R(0.0), w18); w42 = w42 + w18;
 w18 = w54 * w70; w76 = w33 * w61; w76 = V(where)(w39 != R(0.0), w76); w69 = w41 * w70; w76 = w76 + w69;
 w76 = R(2.0) * w76; w76 = lam[0] * w76; w33 = w33 * w76; w33 = V(where)(w9 != R(0.0), w33); w18 = w18 + w33;
 w42 = w42 + w18; w18 = w55 * w63; w33 = w21 * w61; w33 = V(where)(w39 != R(0.0), w33); w69 = w41 * w63;
 w33 = w33 + w69; w33 = R(2.0) * w33; w40 = lam[0] * w33; w21 = w21 * w40; w21 = V(where)(w9 != R(0.0), w21);
 w18 = w18 + w21; w42 = w42 + w18; w30 = w30 * w42; w53 = w53 + w30; w50 = w50 * w53; w68 = w68 + w50;
 w68 = V(where)(w9 != R(0.0), w68); w68 = V(where)(w39 != R(0.0), w68); w68 = V(where)(w28 != R(0.0), w68);
 w48 = w48 + w68; w42 = w42 / w38; w52 = w52 * w74; w52 = -w52; w52 = V(where)(w28 != R(0.0), w52); w42 = w42 + w52;
 w36 = prepared[33] * w42; w36 = -w36; w36 = V(where)(w9 != R(0.0), w36); w36 = V(where)(w39 != R(0.0), w36);
 w48 = w48 + w36; w8 = prepared[59] * w48; w54 = w54 * w61; w54 = V(where)(w39 != R(0.0), w54); w76 = w41 * w76;
 w76 = V(where)(w9 != R(0.0), w76); w54 = w54 + w76; w54 = -w54; w54 = V(where)(w9 != R(0.0), w54); w70 = R(2.0) * w70;
 w70 = w56 * w70; w49 = w49 * w53; w70 = w70 + w49; w70 = V(where)(w9 != R(0.0), w70);
 w70 = V(where)(w39 != R(0.0), w70); w70 = V(where)(w28 != R(0.0), w70); w54 = w54 + w70; w31 = prepared[32] * w42;
 w31 = -w31; w31 = V(where)(w9 != R(0.0), w31); w31 = V(where)(w39 != R(0.0), w31); w54 = w54 + w31;
 w34 = prepared[58] * w54; w8 = w8 + w34; w55 = w55 * w61; w55 = V(where)(w39 != R(0.0), w55); w41 = w41 * w40;
 w41 = V(where)(w9 != R(0.0), w41); w55 = w55 + w41; w55 = -w55; w55 = V(where)(w9 != R(0.0), w55); w63 = R(2.0) * w63;
 w56 = w56 * w63; w45 = w45 * w53; w56 = w56 + w45; w56 = V(where)(w9 != R(0.0), w56);
 w56 = V(where)(w39 != R(0.0), w56); w28 = V(where)(w28 != R(0.0), w56); w55 = w55 + w28; w10 = prepared[31] * w42;
 w10 = -w10; w9 = V(where)(w9 != R(0.0), w10); w39 = V(where)(w39 != R(0.0), w9); w55 = w55 + w39;
 w22 = prepared[57] * w55; w8 = w8 + w22; w22 = y[3] * w8; w58 = w58 + w22; w22 = prepared[37] * w58; w39 = w5 * w22;
 w58 = prepared[36] * w58; w9 = w12 * w58; w39 = w39 + w9; w37 = prepared[56] * w48; w32 = prepared[55] * w54;
 w37 = w37 + w32; w11 = prepared[54] * w55; w37 = w37 + w11; w11 = y[3] * w37; w64 = w64 + w11;
 w11 = prepared[37] * w64; w32 = w20 * w11; w39 = w39 + w32; w64 = prepared[36] * w64; w32 = w16 * w64; w39 = w39 - w32;
 w39 = w1 * w39; w16 = w16 * w58; w20 = w20 * w22; w16 = w16 - w20; w5 = w5 * w11; w16 = w16 + w5; w12 = w12 * w64;
 w16 = w16 + w12; w16 = w0 * w16; w39 = w39 - w16; r3 = w39; w39 = w0 * w11; w16 = w1 * w22; w39 = w39 - w16;
 w19 = prepared[34] * w39; w39 = w1 * w58; w16 = w0 * w64; w39 = w39 - w16; w15 = prepared[35] * w39; w19 = w19 + w15;
 w4 = w4 * w19; w24 = prepared[62] * w48; w35 = prepared[61] * w54; w24 = w24 + w35; w25 = prepared[60] * w55;
 w24 = w24 + w25; w7 = y[3] * w24; w62 = w62 + w7; w6 = prepared[37] * w62; w29 = prepared[29] * w6;
 w17 = prepared[36] * w62; w26 = prepared[28] * w17; w29 = w29 - w26; w22 = w0 * w22; w11 = w1 * w11; w22 = w22 + w11;
 w2 = prepared[27] * w22; w29 = w29 - w2; w0 = w0 * w58; w1 = w1 * w64; w0 = w0 + w1; w13 = prepared[25] * w0;
 w29 = w29 + w13; w3 = w3 * w29; w4 = w4 - w3; r4 = w4; w27 = w27 * w24; w23 = w23 * w8; w27 = w27 + w23;
 w14 = w14 * w37; w27 = w27 + w14; r5 = w27; bend[0] += r0; bend[1] += r1; bend[13] += r2; bend[3] += r3;
 bend[15] += r4; bend[39] += r5;
}

static void torques_at(const real *load, const real *y, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35;
 real w36, w37, w38, w39, w40, w41, w42, w43, w44, w45, w46, w47;
 real w48, w49, w50, w51, w52, w53, w54, w55, w56, w57, w58, w59; real w60, w61, w62, r0, r1, r2, r3;
 w0 = load[21] * y[8]; w4 = V(sin)(y[0]); w6 = w4 * load[4]; w3 = V(cos)(y[0]); w8 = w3 * load[5]; w6 = w6 - w8;
 w2 = load[7] * w6; w3 = w3 * load[4]; w4 = w4 * load[5]; w3 = w3 + w4; w8 = load[8] * w3; w2 = w2 + w8; w0 = w0 + w2;
 w4 = V(sin)(y[1]); w7 = load[1] * w4; w10 = w7 * y[4]; w12 = w10 * y[5]; w8 = V(cos)(y[1]); w13 = load[1] * w8;
 w14 = w13 * y[8]; w12 = w12 - w14; w14 = load[23] * w12; w16 = w7 * y[8]; w17 = w13 * y[4]; w18 = w17 * y[5];
 w16 = w16 + w18; w18 = load[25] * w16; w14 = w14 + w18; w1 = load[0] * y[8]; w1 = w1 + y[9]; w20 = load[26] * w1;
 w14 = w14 + w20; w9 = load[0] * y[4]; w9 = w9 + y[5]; w11 = load[23] * w10; w21 = load[22] * w17; w11 = w11 - w21;
 w22 = load[24] * w9; w11 = w11 + w22; w22 = w9 * w11; w23 = load[26] * w10; w24 = load[24] * w17; w23 = w23 - w24;
 w25 = load[27] * w9; w23 = w23 + w25; w25 = w17 * w23; w22 = w22 + w25; w14 = w14 + w22; w25 = w4 * w6;
 w26 = load[0] * w8; w26 = w26 * w3; w25 = w25 - w26; w27 = w13 * load[6]; w25 = w25 + w27; w27 = load[12] * w25;
 w2 = load[1] * w3; w29 = load[0] * load[6]; w2 = w2 + w29; w29 = load[10] * w2; w27 = w27 + w29; w14 = w14 + w27;
 w29 = V(sin)(y[2]); w27 = V(cos)(y[2]); w32 = load[2] * w27; w33 = w32 * w12; w34 = w29 * w16; w33 = w33 + w34;
 w35 = load[3] * w27; w36 = w35 * w1; w33 = w33 - w36; w36 = load[2] * w29; w37 = w36 * w17; w38 = w27 * w10;
 w37 = w37 + w38; w38 = load[3] * w29; w39 = w38 * w9; w37 = w37 + w39; w40 = w37 * y[6]; w33 = w33 + w40;
 w40 = load[28] * w33; w42 = w27 * w16; w43 = w36 * w12; w42 = w42 - w43; w43 = w38 * w1; w42 = w42 + w43;
 w43 = w29 * w10; w44 = w32 * w17; w43 = w43 - w44; w44 = w35 * w9; w43 = w43 - w44; w44 = w43 * y[6]; w42 = w42 - w44;
 w44 = load[29] * w42; w40 = w40 + w44; w45 = load[3] * w12; w46 = load[2] * w1; w45 = w45 + w46; w45 = w45 + y[10];
 w46 = load[30] * w45; w40 = w40 + w46; w46 = load[30] * w43; w48 = load[32] * w37; w46 = w46 + w48; w49 = load[2] * w9;
 w50 = load[3] * w17; w49 = w49 - w50; w49 = w49 + y[6]; w39 = load[33] * w49; w46 = w46 + w39; w39 = w37 * w46;
 w50 = load[29] * w43; w52 = load[31] * w37; w50 = w50 + w52; w52 = load[32] * w49; w50 = w50 + w52; w52 = w49 * w50;
 w39 = w39 - w52; w40 = w40 + w39; w52 = load[3] * w25; w53 = load[2] * w2; w52 = w52 - w53; w53 = load[14] * w52;
 w4 = load[0] * w4; w4 = w4 * w3; w8 = w8 * w6; w4 = w4 + w8; w26 = w7 * load[6]; w4 = w4 - w26; w26 = w27 * w4;
 w8 = w36 * w25; w26 = w26 - w8; w8 = w38 * w2; w26 = w26 - w8; w8 = load[15] * w26; w53 = w53 - w8; w40 = w40 + w53;
 w6 = w52 + y[11]; w3 = w33 * load[36]; w56 = w42 * load[35]; w3 = w3 - w56; w6 = w6 + w3; w3 = w49 * load[35];
 w56 = load[37] + y[3]; w57 = w43 * w56; w3 = w3 - w57; w57 = w43 * w3; w58 = w37 * w56; w59 = w49 * load[36];
 w58 = w58 - w59; w59 = w37 * w58; w57 = w57 - w59; w6 = w6 + w57; w6 = load[34] * w6; w57 = load[36] * w6; w59 = -w43;
 w59 = R(2.0) * w59; w59 = w59 * y[7]; w59 = w26 + w59; w61 = w45 * load[35]; w62 = w33 * w56; w61 = w61 - w62;
 w59 = w59 + w61; w58 = w49 * w58; w61 = w43 * load[36]; w62 = w37 * load[35]; w61 = w61 - w62; w62 = w43 * w61;
 w58 = w58 - w62; w59 = w59 + w58; w59 = load[34] * w59; w58 = w56 * w59; w57 = w57 - w58; w40 = w40 + w57;
 w57 = w29 * w40; w58 = load[29] * w33; w51 = load[31] * w42; w58 = w58 + w51; w51 = load[32] * w45; w58 = w58 + w51;
 w30 = load[28] * w43; w41 = load[29] * w37; w30 = w30 + w41; w41 = load[30] * w49; w30 = w30 + w41; w41 = w49 * w30;
 w46 = w43 * w46; w41 = w41 - w46; w58 = w58 + w41; w41 = w32 * w25; w29 = w29 * w4; w41 = w41 + w29; w29 = w35 * w2;
 w41 = w41 + w29; w54 = load[15] * w41; w52 = load[13] * w52; w54 = w54 - w52; w58 = w58 + w54; w54 = R(2.0) * w37;
 w54 = w54 * y[7]; w54 = w41 + w54; w60 = w42 * w56; w52 = w45 * load[36]; w60 = w60 - w52; w54 = w54 + w60;
 w61 = w37 * w61; w49 = w49 * w3; w61 = w61 - w49; w54 = w54 + w61; w8 = load[34] * w54; w56 = w56 * w8;
 w54 = load[35] * w6; w56 = w56 - w54; w58 = w58 + w56; w27 = w27 * w58; w57 = w57 + w27; w14 = w14 + w57;
 w7 = w7 * w14; w20 = load[22] * w12; w14 = load[23] * w16; w20 = w20 + w14; w14 = load[24] * w1; w20 = w20 + w14;
 w23 = w10 * w23; w15 = load[25] * w10; w5 = load[23] * w17; w15 = w15 - w5; w5 = load[26] * w9; w15 = w15 + w5;
 w9 = w9 * w15; w23 = w23 - w9; w20 = w20 + w23; w2 = load[11] * w2; w22 = load[12] * w4; w2 = w2 + w22; w20 = w20 - w2;
 w32 = w32 * w40; w36 = w36 * w58; w32 = w32 - w36; w44 = load[30] * w33; w47 = load[32] * w42; w44 = w44 + w47;
 w48 = load[33] * w45; w44 = w44 + w48; w43 = w43 * w50; w37 = w37 * w30; w43 = w43 - w37; w44 = w44 + w43;
 w29 = load[13] * w26; w39 = load[14] * w41; w29 = w29 - w39; w44 = w44 + w29; w55 = load[35] * w59;
 w53 = load[36] * w8; w55 = w55 - w53; w44 = w44 + w55; w34 = load[3] * w44; w32 = w32 + w34; w20 = w20 + w32;
 w13 = w13 * w20; w7 = w7 - w13; w21 = load[24] * w12; w18 = load[26] * w16; w21 = w21 + w18; w24 = load[27] * w1;
 w21 = w21 + w24; w17 = w17 * w15; w10 = w10 * w11; w17 = w17 + w10; w21 = w21 - w17; w28 = load[10] * w4;
 w23 = load[11] * w25; w28 = w28 - w23; w21 = w21 + w28; w38 = w38 * w58; w35 = w35 * w40; w38 = w38 - w35;
 w31 = load[2] * w44; w38 = w38 + w31; w21 = w21 + w38; w19 = load[0] * w21; w7 = w7 + w19; w0 = w0 + w7; r0 = w0;
 r1 = w21; r2 = w44; r3 = w6; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3;
}

static void torques_by(const real *load, const real *y, real *restrict g, real *restrict by)
{
 real w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12;
 real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35, w36;
 real w37, w38, w39, w40, w41, w42, w43, w44, w45, w46, w47, w48;
 real w49, w50, w51, w52, w53, w54, w55, w56, w57, w58, w59, w60;
 real w61, w62, w63, w64, w65, w66, w67, w68, w69, w70, w71, w72;
 real w73, w74, w75, w76, w77, w78, w79, w80, w81, w82, w83, w84;
 real w85, w86, w87, w88, w89, w90, w91, w92, w93, w94, w95, w96;
 real w97, w98, w99, w100, w101, w102, w103, w104, w105, w106, w107, w108;
 real w109, w110, w111, w112, w113, w114, w115, w116, w117, w118, r0, r1;
 real r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13;
 real r14, r15, r16, r17, r18, r19, r20, r21, r22, r23, r24, r25;
 real r26, r27, r28, r29, r30, r31, r32, r33, r34, r35, r36, r37;
 real r38, r39, r40, r41, r42, r43, r44, r45, r46, r47, r48; w2 = load[21] * y[8]; w5 = V(sin)(y[0]); w7 = w5 * load[4];
 w4 = V(cos)(y[0]); w9 = w4 * load[5]; w7 = w7 - w9; w9 = load[7] * w7; w11 = w4 * load[4]; w12 = w5 * load[5];
 w11 = w11 + w12; w12 = load[8] * w11; w9 = w9 + w12; w2 = w2 + w9; w13 = V(sin)(y[1]); w14 = load[1] * w13;
 w17 = w14 * y[4]; w19 = w17 * y[5]; w12 = V(cos)(y[1]); w20 = load[1] * w12; w21 = w20 * y[8]; w19 = w19 - w21;
 w21 = load[23] * w19; w23 = w14 * y[8]; w24 = w20 * y[4]; w25 = w24 * y[5]; w23 = w23 + w25; w25 = load[25] * w23;
 w21 = w21 + w25; w27 = load[0] * y[8]; w27 = w27 + y[9]; w28 = load[26] * w27; w21 = w21 + w28; w28 = load[0] * y[4];
 w28 = w28 + y[5]; w29 = load[23] * w17; w31 = load[22] * w24; w31 = w29 - w31; w33 = load[24] * w28; w31 = w31 + w33;
 w33 = w28 * w31; w34 = load[26] * w17; w35 = load[24] * w24; w34 = w34 - w35; w36 = load[27] * w28; w34 = w34 + w36;
 w36 = w24 * w34; w33 = w33 + w36; w21 = w21 + w33; w36 = w13 * w7; w37 = load[0] * w12; w38 = w37 * w11;
 w36 = w36 - w38; w39 = w20 * load[6]; w36 = w36 + w39; w39 = load[12] * w36; w41 = load[1] * w11;
 w42 = load[0] * load[6]; w41 = w41 + w42; w42 = load[10] * w41; w39 = w39 + w42; w21 = w21 + w39; w42 = V(sin)(y[2]);
 w39 = V(cos)(y[2]); w45 = load[2] * w39; w46 = w45 * w19; w47 = w42 * w23; w46 = w46 + w47; w48 = load[3] * w39;
 w49 = w48 * w27; w46 = w46 - w49; w49 = load[2] * w42; w50 = w49 * w24; w51 = w39 * w17; w50 = w50 + w51;
 w51 = load[3] * w42; w52 = w51 * w28; w50 = w50 + w52; w53 = w50 * y[6]; w46 = w46 + w53; w53 = load[28] * w46;
 w55 = w39 * w23; w56 = w49 * w19; w55 = w55 - w56; w56 = w51 * w27; w55 = w55 + w56; w56 = w42 * w17; w57 = w45 * w24;
 w56 = w56 - w57; w57 = w48 * w28; w56 = w56 - w57; w57 = w56 * y[6]; w55 = w55 - w57; w57 = load[29] * w55;
 w53 = w53 + w57; w58 = load[3] * w19; w59 = load[2] * w27; w58 = w58 + w59; w58 = w58 + y[10]; w59 = load[30] * w58;
 w53 = w53 + w59; w59 = load[30] * w56; w61 = load[32] * w50; w59 = w59 + w61; w62 = load[2] * w28; w63 = load[3] * w24;
 w62 = w62 - w63; w62 = w62 + y[6]; w63 = load[33] * w62; w59 = w59 + w63; w63 = w50 * w59; w64 = load[29] * w56;
 w66 = load[31] * w50; w66 = w64 + w66; w67 = load[32] * w62; w66 = w66 + w67; w67 = w62 * w66; w63 = w63 - w67;
 w53 = w53 + w63; w67 = load[3] * w36; w68 = load[2] * w41; w67 = w67 - w68; w68 = load[14] * w67; w70 = load[0] * w13;
 w71 = w70 * w11; w72 = w12 * w7; w71 = w71 + w72; w72 = w14 * load[6]; w71 = w71 - w72; w72 = w39 * w71;
 w73 = w49 * w36; w72 = w72 - w73; w73 = w51 * w41; w72 = w72 - w73; w73 = load[15] * w72; w68 = w68 - w73;
 w53 = w53 + w68; w74 = w67 + y[11]; w75 = w46 * load[36]; w77 = w55 * load[35]; w75 = w75 - w77; w74 = w74 + w75;
 w75 = w62 * load[35]; w77 = load[37] + y[3]; w78 = w56 * w77; w75 = w75 - w78; w78 = w56 * w75; w79 = w50 * w77;
 w80 = w62 * load[36]; w79 = w79 - w80; w80 = w50 * w79; w78 = w78 - w80; w74 = w74 + w78; w74 = load[34] * w74;
 w78 = load[36] * w74; w80 = -w56; w80 = R(2.0) * w80; w82 = w80 * y[7]; w82 = w72 + w82; w83 = w58 * load[35];
 w84 = w46 * w77; w83 = w83 - w84; w82 = w82 + w83; w83 = w62 * w79; w84 = w56 * load[36]; w85 = w50 * load[35];
 w84 = w84 - w85; w85 = w56 * w84; w83 = w83 - w85; w82 = w82 + w83; w82 = load[34] * w82; w83 = w77 * w82;
 w78 = w78 - w83; w53 = w53 + w78; w78 = w42 * w53; w83 = load[29] * w46; w85 = load[31] * w55; w83 = w83 + w85;
 w85 = load[32] * w58; w83 = w83 + w85; w85 = load[28] * w56; w86 = load[29] * w50; w85 = w85 + w86;
 w87 = load[30] * w62; w85 = w85 + w87; w87 = w62 * w85; w88 = w56 * w59; w87 = w87 - w88; w83 = w83 + w87;
 w87 = w45 * w36; w88 = w42 * w71; w87 = w87 + w88; w88 = w48 * w41; w87 = w87 + w88; w88 = load[15] * w87;
 w67 = load[13] * w67; w88 = w88 - w67; w83 = w83 + w88; w88 = R(2.0) * w50; w67 = w88 * y[7]; w67 = w87 + w67;
 w90 = w55 * w77; w91 = w58 * load[36]; w90 = w90 - w91; w67 = w67 + w90; w90 = w50 * w84; w91 = w62 * w75;
 w90 = w90 - w91; w67 = w67 + w90; w67 = load[34] * w67; w90 = w77 * w67; w91 = load[35] * w74; w90 = w90 - w91;
 w83 = w83 + w90; w90 = w39 * w83; w78 = w78 + w90; w21 = w21 + w78; w78 = w14 * w21; w90 = load[22] * w19;
 w91 = load[23] * w23; w90 = w90 + w91; w91 = load[24] * w27; w90 = w90 + w91; w91 = w17 * w34; w92 = load[25] * w17;
 w93 = load[23] * w24; w92 = w92 - w93; w94 = load[26] * w28; w92 = w92 + w94; w94 = w28 * w92; w91 = w91 - w94;
 w90 = w90 + w91; w94 = load[11] * w41; w95 = load[12] * w71; w94 = w94 + w95; w90 = w90 - w94; w94 = w45 * w53;
 w95 = w49 * w83; w94 = w94 - w95; w95 = load[30] * w46; w96 = load[32] * w55; w95 = w95 + w96; w58 = load[33] * w58;
 w95 = w95 + w58; w58 = w56 * w66; w96 = w50 * w85; w58 = w58 - w96; w95 = w95 + w58; w72 = load[13] * w72;
 w87 = load[14] * w87; w72 = w72 - w87; w95 = w95 + w72; w72 = load[35] * w82; w87 = load[36] * w67; w72 = w72 - w87;
 w95 = w95 + w72; w72 = load[3] * w95; w94 = w94 + w72; w90 = w90 + w94; w94 = w20 * w90; w78 = w78 - w94;
 w94 = load[24] * w19; w72 = load[26] * w23; w94 = w94 + w72; w72 = load[27] * w27; w94 = w94 + w72; w72 = w24 * w92;
 w87 = w17 * w31; w72 = w72 + w87; w94 = w94 - w72; w72 = load[10] * w71; w87 = load[11] * w36; w72 = w72 - w87;
 w94 = w94 + w72; w72 = w51 * w83; w87 = w48 * w53; w72 = w72 - w87; w87 = load[2] * w95; w72 = w72 + w87;
 w94 = w94 + w72; w72 = load[0] * w94; w78 = w78 + w72; w2 = w2 + w78; r0 = w2; r1 = w94; r2 = w95; r3 = w74;
 w74 = load[10] * load[0]; w95 = load[12] * w20; w74 = w74 + w95; w95 = w51 * load[0]; w94 = w49 * w20; w95 = w95 + w94;
 w94 = w39 * w14; w95 = w95 + w94; w94 = w77 * w95; w2 = load[2] * load[0]; w78 = load[3] * w20; w2 = w2 - w78;
 w78 = load[36] * w2; w94 = w94 - w78; w94 = load[34] * w94; w78 = load[14] * w2; w78 = w94 - w78; w72 = load[15] * w95;
 w78 = w78 + w72; w72 = w42 * w78; w74 = w74 + w72; w72 = load[13] * w2; w87 = load[35] * w2; w58 = w42 * w14;
 w96 = w48 * load[0]; w97 = w45 * w20; w96 = w96 + w97; w58 = w58 - w96; w96 = w77 * w58; w87 = w87 - w96;
 w87 = load[34] * w87; w72 = w72 + w87; w96 = load[15] * w58; w72 = w72 - w96; w96 = w39 * w72; w74 = w74 + w96;
 w96 = w70 * w74; w97 = load[11] * w20; w98 = w48 * w78; w97 = w97 + w98; w98 = w51 * w72; w97 = w97 - w98;
 w98 = load[36] * w58; w99 = load[35] * w95; w98 = w98 - w99; w98 = load[34] * w98; w99 = load[13] * w95;
 w99 = w98 - w99; w100 = load[14] * w58; w99 = w99 + w100; w100 = load[2] * w99; w97 = w97 - w100;
 w100 = load[10] * w14; w97 = w97 + w100; w97 = load[1] * w97; w96 = w96 + w97; w97 = w45 * w78;
 w100 = load[11] * load[0]; w97 = w97 - w100; w100 = w49 * w72; w97 = w97 - w100; w99 = load[3] * w99; w97 = w97 + w99;
 w33 = load[12] * w14; w97 = w97 + w33; w33 = w37 * w97; w96 = w96 - w33; w96 = w96 + load[8]; w10 = load[5] * w96;
 w33 = w12 * w74; w99 = w13 * w97; w33 = w33 + w99; w33 = w33 + load[7]; w3 = load[4] * w33; w10 = w10 + w3;
 w10 = w4 * w10; w96 = load[4] * w96; w33 = load[5] * w33; w96 = w96 - w33; w96 = w5 * w96; w10 = w10 - w96; r4 = w10;
 w10 = w77 * w51; w96 = load[36] * load[2]; w10 = w10 - w96; w10 = load[34] * w10; w96 = load[14] * load[2];
 w96 = w10 - w96; w33 = load[15] * w51; w96 = w96 + w33; w33 = w42 * w96; w40 = load[10] + w33;
 w33 = load[13] * load[2]; w3 = load[35] * load[2]; w99 = w77 * w48; w3 = w3 + w99; w3 = load[34] * w3; w33 = w33 + w3;
 w69 = load[15] * w48; w33 = w33 + w69; w69 = w39 * w33; w40 = w40 + w69; w69 = w70 * w40; w99 = w48 * w96;
 w100 = w51 * w33; w99 = w99 - w100; w100 = load[13] * w51; w101 = load[35] * w51; w102 = load[36] * w48;
 w101 = w101 + w102; w101 = load[34] * w101; w100 = w100 + w101; w102 = load[14] * w48; w100 = w100 + w102;
 w102 = load[2] * w100; w99 = w99 + w102; w99 = load[1] * w99; w69 = w69 + w99; w99 = w45 * w96; w99 = w99 - load[11];
 w91 = w49 * w33; w99 = w99 - w91; w100 = load[3] * w100; w99 = w99 - w100; w100 = w37 * w99; w69 = w69 - w100;
 w100 = load[5] * w69; w91 = w12 * w40; w102 = w13 * w99; w91 = w91 + w102; w102 = load[4] * w91; w100 = w100 + w102;
 w100 = w4 * w100; w69 = load[4] * w69; w91 = load[5] * w91; w69 = w69 - w91; w69 = w5 * w69; w100 = w100 - w69;
 r5 = w100; w100 = load[34] * load[35]; w89 = load[13] + w100; w69 = w39 * w89; w91 = load[34] * load[36];
 w63 = load[14] + w91; w102 = w42 * w63; w69 = w69 - w102; w70 = w70 * w69; w102 = w48 * w63; w103 = w51 * w89;
 w102 = w102 + w103; w102 = load[1] * w102; w70 = w70 - w102; w102 = w45 * w63; w103 = w49 * w89; w102 = w102 + w103;
 w103 = w37 * w102; w70 = w70 + w103; w103 = load[5] * w70; w104 = w12 * w69; w105 = w13 * w102; w104 = w104 - w105;
 w105 = load[4] * w104; w103 = w103 + w105; w103 = w4 * w103; w70 = load[4] * w70; w104 = load[5] * w104;
 w70 = w70 - w104; w70 = w5 * w70; w103 = w103 - w70; r6 = w103; w103 = load[2] * load[34]; w103 = load[1] * w103;
 w70 = load[3] * load[34]; w37 = w37 * w70; w103 = w103 + w37; w37 = load[4] * w103; w104 = w13 * w70;
 w105 = load[5] * w104; w37 = w37 + w105; w5 = w5 * w37; w6 = load[4] * w104; w8 = load[5] * w103; w6 = w6 - w8;
 w4 = w4 * w6; w5 = w5 + w4; r7 = w5; w5 = w11 * w74; w5 = load[0] * w5; w4 = w7 * w97; w5 = w5 + w4;
 w4 = load[6] * w74; w21 = w21 - w4; w4 = load[26] * load[0]; w6 = load[23] * w20; w4 = w4 - w6; w6 = load[32] * w2;
 w8 = w77 * w94; w6 = w6 + w8; w8 = load[31] * w95; w6 = w6 + w8; w8 = load[35] * w98; w6 = w6 - w8;
 w8 = load[29] * w58; w6 = w6 + w8; w8 = w39 * w6; w4 = w4 + w8; w8 = load[30] * w2; w103 = load[29] * w95;
 w8 = w8 + w103; w103 = w77 * w87; w8 = w8 - w103; w103 = load[36] * w98; w8 = w8 + w103; w103 = load[28] * w58;
 w8 = w8 + w103; w103 = w42 * w8; w4 = w4 + w103; w103 = load[25] * w14; w4 = w4 + w103; w103 = y[8] * w4;
 w21 = w21 + w103; w103 = w28 * w20; w104 = w24 * load[0]; w103 = w103 - w104; w104 = load[25] * w103;
 w37 = w31 * load[0]; w104 = w104 - w37; w37 = w34 * w20; w104 = w104 - w37; w37 = w66 * w2; w105 = w59 * w95;
 w37 = w37 - w105; w105 = w62 * w95; w106 = w50 * w2; w105 = w105 - w106; w106 = load[28] * w105; w37 = w37 + w106;
 w106 = w84 * w87; w37 = w37 - w106; w106 = w50 * w94; w107 = w56 * w87; w106 = w106 - w107; w107 = load[36] * w106;
 w37 = w37 + w107; w107 = y[7] * w87; w107 = R(2.0) * w107; w37 = w37 - w107; w107 = w75 * w98; w37 = w37 + w107;
 w107 = w56 * w98; w108 = w62 * w94; w107 = w107 - w108; w108 = w77 * w107; w37 = w37 - w108; w108 = w56 * w2;
 w109 = w62 * w58; w108 = w108 - w109; w109 = load[29] * w108; w37 = w37 + w109; w109 = w50 * w58; w110 = w56 * w95;
 w109 = w109 - w110; w110 = load[30] * w109; w37 = w37 + w110; w110 = y[6] * w6; w37 = w37 - w110; w110 = w42 * w37;
 w104 = w104 + w110; w110 = w84 * w94; w111 = w85 * w2; w110 = w110 - w111; w111 = y[7] * w94; w111 = R(2.0) * w111;
 w110 = w110 + w111; w111 = load[29] * w105; w110 = w110 + w111; w106 = load[35] * w106; w110 = w110 - w106;
 w106 = w79 * w98; w110 = w110 - w106; w106 = w62 * w87; w111 = w50 * w98; w106 = w106 - w111; w111 = w77 * w106;
 w110 = w110 + w111; w111 = load[31] * w108; w110 = w110 + w111; w111 = w59 * w58; w110 = w110 + w111;
 w111 = load[32] * w109; w110 = w110 + w111; w111 = y[6] * w8; w110 = w110 + w111; w111 = w39 * w110;
 w104 = w104 + w111; w111 = w24 * w14; w112 = w17 * w20; w111 = w111 - w112; w112 = load[26] * w111; w104 = w104 + w112;
 w112 = w28 * w14; w113 = w17 * load[0]; w112 = w112 - w113; w113 = load[23] * w112; w104 = w104 + w113;
 w113 = load[24] * load[0]; w114 = load[22] * w20; w113 = w113 - w114; w2 = load[33] * w2; w114 = load[36] * w94;
 w2 = w2 - w114; w114 = load[32] * w95; w2 = w2 + w114; w114 = load[35] * w87; w2 = w2 + w114; w114 = load[30] * w58;
 w2 = w2 + w114; w114 = load[3] * w2; w113 = w113 + w114; w114 = w49 * w6; w113 = w113 - w114; w114 = w45 * w8;
 w113 = w113 + w114; w114 = load[23] * w14; w113 = w113 + w114; w114 = y[5] * w113; w104 = w104 + w114;
 w114 = y[4] * w104; w21 = w21 + w114; w21 = load[1] * w21; w5 = w5 + w21; w5 = w12 * w5; w74 = w7 * w74;
 w21 = w11 * w97; w21 = load[0] * w21; w74 = w74 - w21; w97 = load[6] * w97; w97 = w97 - w90; w90 = w49 * w110;
 w21 = w92 * load[0]; w15 = load[23] * w103; w21 = w21 + w15; w15 = w85 * w95; w114 = w75 * w94; w15 = w15 - w114;
 w105 = load[30] * w105; w15 = w15 + w105; w105 = w79 * w87; w15 = w15 + w105; w105 = load[36] * w106; w15 = w15 - w105;
 w105 = load[35] * w107; w15 = w15 + w105; w105 = w66 * w58; w15 = w15 - w105; w108 = load[32] * w108; w15 = w15 + w108;
 w109 = load[33] * w109; w15 = w15 + w109; w109 = load[3] * w15; w21 = w21 + w109; w109 = w45 * w37; w21 = w21 + w109;
 w90 = w90 - w21; w34 = w34 * w14; w90 = w90 + w34; w34 = load[24] * w111; w90 = w90 - w34; w34 = load[22] * w112;
 w90 = w90 - w34; w34 = y[5] * w4; w90 = w90 + w34; w34 = y[4] * w90; w97 = w97 + w34; w34 = y[8] * w113;
 w97 = w97 - w34; w97 = load[1] * w97; w74 = w74 + w97; w74 = w13 * w74; w5 = w5 - w74; r8 = w5; w5 = w11 * w40;
 w5 = load[0] * w5; w74 = w7 * w99; w5 = w5 + w74; w74 = load[32] * load[2]; w97 = w77 * w10; w74 = w74 + w97;
 w97 = load[31] * w51; w74 = w74 + w97; w97 = load[35] * w101; w74 = w74 + w97; w97 = load[29] * w48; w74 = w74 - w97;
 w97 = w39 * w74; w97 = load[26] + w97; w34 = load[30] * load[2]; w21 = load[29] * w51; w34 = w34 + w21; w21 = w77 * w3;
 w34 = w34 - w21; w21 = load[36] * w101; w34 = w34 - w21; w21 = load[28] * w48; w34 = w34 - w21; w21 = w42 * w34;
 w97 = w97 + w21; w21 = y[8] * w97; w109 = load[6] * w40; w21 = w21 - w109; w109 = w66 * load[2]; w108 = w59 * w51;
 w109 = w109 - w108; w108 = w62 * w51; w105 = w50 * load[2]; w108 = w108 - w105; w105 = load[28] * w108;
 w109 = w109 + w105; w105 = w84 * w3; w109 = w109 - w105; w105 = w50 * w10; w114 = w56 * w3; w105 = w105 - w114;
 w114 = load[36] * w105; w109 = w109 + w114; w114 = y[7] * w3; w114 = R(2.0) * w114; w109 = w109 - w114;
 w114 = w75 * w101; w109 = w109 - w114; w114 = w62 * w10; w115 = w56 * w101; w114 = w114 + w115; w115 = w77 * w114;
 w109 = w109 + w115; w115 = w56 * load[2]; w116 = w62 * w48; w115 = w115 + w116; w116 = load[29] * w115;
 w109 = w109 + w116; w116 = w56 * w51; w117 = w50 * w48; w116 = w116 + w117; w117 = load[30] * w116; w109 = w109 - w117;
 w117 = y[6] * w74; w109 = w109 - w117; w117 = w42 * w109; w22 = load[25] * w24; w22 = w31 + w22; w117 = w117 - w22;
 w22 = w84 * w10; w118 = w85 * load[2]; w22 = w22 - w118; w118 = y[7] * w10; w118 = R(2.0) * w118; w22 = w22 + w118;
 w54 = load[29] * w108; w22 = w22 + w54; w105 = load[35] * w105; w22 = w22 - w105; w105 = w79 * w101; w22 = w22 + w105;
 w105 = w62 * w3; w54 = w50 * w101; w105 = w105 + w54; w54 = w77 * w105; w22 = w22 + w54; w54 = load[31] * w115;
 w22 = w22 + w54; w59 = w59 * w48; w22 = w22 - w59; w59 = load[32] * w116; w22 = w22 - w59; w59 = y[6] * w34;
 w22 = w22 + w59; w59 = w39 * w22; w117 = w117 + w59; w117 = w117 - w29; w29 = load[33] * load[2]; w59 = load[36] * w10;
 w29 = w29 - w59; w59 = load[32] * w51; w29 = w29 + w59; w59 = load[35] * w3; w29 = w29 + w59; w59 = load[30] * w48;
 w29 = w29 - w59; w59 = load[3] * w29; w59 = load[24] + w59; w54 = w49 * w74; w59 = w59 - w54; w54 = w45 * w34;
 w59 = w59 + w54; w54 = y[5] * w59; w117 = w117 + w54; w54 = y[4] * w117; w21 = w21 + w54; w21 = load[1] * w21;
 w5 = w5 + w21; w5 = w12 * w5; w40 = w7 * w40; w21 = w11 * w99; w21 = load[0] * w21; w40 = w40 - w21;
 w99 = load[6] * w99; w93 = w93 - w92; w21 = w85 * w51; w54 = w75 * w10; w21 = w21 - w54; w108 = load[30] * w108;
 w21 = w21 + w108; w108 = w79 * w3; w21 = w21 + w108; w108 = load[36] * w105; w21 = w21 - w108; w108 = load[35] * w114;
 w21 = w21 - w108; w108 = w66 * w48; w21 = w21 + w108; w115 = load[32] * w115; w21 = w21 + w115; w116 = load[33] * w116;
 w21 = w21 - w116; w116 = load[3] * w21; w93 = w93 - w116; w116 = w45 * w109; w93 = w93 - w116; w116 = w49 * w22;
 w93 = w93 + w116; w30 = load[22] * w17; w93 = w93 + w30; w30 = y[5] * w97; w93 = w93 + w30; w30 = y[4] * w93;
 w99 = w99 + w30; w30 = y[8] * w59; w99 = w99 - w30; w99 = load[1] * w99; w40 = w40 + w99; w40 = w13 * w40;
 w5 = w5 - w40; r9 = w5; w5 = w11 * w69; w5 = load[0] * w5; w40 = w7 * w102; w5 = w5 - w40; w40 = w77 * w91;
 w40 = load[32] - w40; w99 = w39 * w40; w30 = w77 * w100; w30 = load[30] - w30; w116 = w42 * w30; w99 = w99 + w116;
 w116 = y[8] * w99; w115 = load[6] * w69; w116 = w116 - w115; w43 = load[28] * w50; w66 = w66 - w43; w43 = w84 * w100;
 w66 = w66 - w43; w43 = w50 * w91; w115 = w56 * w100; w43 = w43 + w115; w115 = load[36] * w43; w66 = w66 - w115;
 w115 = y[7] * w100; w115 = R(2.0) * w115; w66 = w66 - w115; w115 = w62 * w91; w108 = w77 * w115; w66 = w66 - w108;
 w66 = w66 + w64; w64 = y[6] * w40; w66 = w66 - w64; w64 = w42 * w66; w81 = y[7] * w91; w81 = -w81; w81 = R(2.0) * w81;
 w84 = w84 * w91; w85 = w85 + w84; w81 = w81 - w85; w81 = w81 - w86; w43 = load[35] * w43; w81 = w81 + w43;
 w62 = w62 * w100; w43 = w77 * w62; w81 = w81 + w43; w65 = load[31] * w56; w81 = w81 + w65; w65 = y[6] * w30;
 w81 = w81 + w65; w65 = w39 * w81; w64 = w64 + w65; w65 = load[36] * w91; w61 = load[33] + w65; w65 = load[35] * w100;
 w61 = w61 + w65; w65 = load[3] * w61; w43 = w49 * w40; w65 = w65 - w43; w43 = w45 * w30; w65 = w65 + w43;
 w43 = y[5] * w65; w64 = w64 + w43; w43 = y[4] * w64; w116 = w116 + w43; w116 = load[1] * w116; w5 = w5 + w116;
 w5 = w12 * w5; w69 = w7 * w69; w116 = w11 * w102; w116 = load[0] * w116; w69 = w69 + w116; w116 = w49 * w81;
 w43 = w75 * w91; w57 = load[30] * w50; w43 = w43 - w57; w57 = w79 * w100; w43 = w43 + w57; w57 = load[36] * w62;
 w43 = w43 - w57; w57 = load[35] * w115; w43 = w43 + w57; w60 = load[32] * w56; w43 = w43 + w60; w60 = load[3] * w43;
 w57 = w45 * w66; w60 = w60 + w57; w116 = w116 - w60; w60 = y[5] * w99; w116 = w116 + w60; w60 = y[4] * w116;
 w102 = load[6] * w102; w60 = w60 - w102; w102 = y[8] * w65; w60 = w60 - w102; w60 = load[1] * w60; w69 = w69 + w60;
 w69 = w13 * w69; w5 = w5 - w69; r10 = w5; w7 = w7 * w70; w5 = load[36] * load[34]; w69 = w42 * w5;
 w60 = load[35] * load[34]; w102 = w39 * w60; w69 = w69 - w102; w102 = y[8] * w69; w75 = w75 * load[34];
 w57 = w56 * load[34]; w86 = w77 * w57; w75 = w75 - w86; w86 = y[6] * w60; w75 = w75 + w86; w86 = w42 * w75;
 w52 = y[6] * w5; w79 = w79 * load[34]; w85 = w50 * load[34]; w77 = w77 * w85; w79 = w79 + w77; w52 = w52 - w79;
 w79 = w39 * w52; w86 = w86 + w79; w79 = w49 * w60; w77 = w45 * w5; w79 = w79 + w77; w77 = y[5] * w79; w86 = w86 + w77;
 w77 = y[4] * w86; w102 = w102 + w77; w102 = load[1] * w102; w7 = w7 + w102; w12 = w12 * w7; w38 = load[6] * w70;
 w49 = w49 * w52; w68 = load[36] * w85; w76 = load[35] * w57; w68 = w68 + w76; w76 = load[3] * w68; w45 = w45 * w75;
 w76 = w76 + w45; w49 = w49 - w76; w18 = y[5] * w69; w49 = w49 + w18; w16 = y[4] * w49; w38 = w38 + w16;
 w1 = y[8] * w79; w38 = w38 - w1; w9 = load[1] * w38; w11 = w11 * w70; w11 = load[0] * w11; w9 = w9 - w11;
 w13 = w13 * w9; w12 = w12 - w13; r11 = w12; w12 = w71 * w78; w13 = w53 * w14; w12 = w12 + w13; w13 = w17 * w37;
 w12 = w12 + w13; w13 = w83 * load[0]; w9 = w41 * w72; w13 = w13 - w9; w9 = w27 * w6; w13 = w13 + w9; w9 = w28 * w110;
 w13 = w13 + w9; w13 = load[3] * w13; w12 = w12 + w13; w13 = w83 * w20; w9 = w36 * w72; w13 = w13 - w9; w9 = w19 * w6;
 w13 = w13 - w9; w9 = w24 * w110; w13 = w13 + w9; w13 = load[2] * w13; w12 = w12 + w13; w13 = w23 * w8; w12 = w12 + w13;
 w12 = w39 * w12; w13 = w83 * w14; w72 = w71 * w72; w13 = w13 + w72; w72 = w23 * w6; w13 = w13 + w72; w72 = w17 * w110;
 w13 = w13 + w72; w72 = w41 * w78; w9 = w53 * load[0]; w72 = w72 - w9; w9 = w28 * w37; w72 = w72 - w9; w9 = w27 * w8;
 w72 = w72 - w9; w72 = load[3] * w72; w13 = w13 + w72; w78 = w36 * w78; w72 = w53 * w20; w78 = w78 - w72;
 w72 = w24 * w37; w78 = w78 - w72; w72 = w19 * w8; w78 = w78 + w72; w78 = load[2] * w78; w13 = w13 + w78;
 w13 = w42 * w13; w12 = w12 - w13; r12 = w12; w12 = w71 * w96; w13 = w17 * w109; w12 = w12 + w13; w13 = w41 * w33;
 w83 = w83 - w13; w13 = w27 * w74; w83 = w83 + w13; w13 = w28 * w22; w83 = w83 + w13; w83 = load[3] * w83;
 w12 = w12 + w83; w83 = w24 * w22; w13 = w36 * w33; w78 = w19 * w74; w13 = w13 + w78; w83 = w83 - w13;
 w83 = load[2] * w83; w12 = w12 + w83; w83 = w23 * w34; w12 = w12 + w83; w12 = w39 * w12; w33 = w71 * w33;
 w83 = w23 * w74; w33 = w33 + w83; w83 = w17 * w22; w33 = w33 + w83; w83 = w41 * w96; w83 = w83 - w53; w53 = w28 * w109;
 w83 = w83 - w53; w53 = w27 * w34; w83 = w83 - w53; w83 = load[3] * w83; w33 = w33 + w83; w96 = w36 * w96;
 w83 = w24 * w109; w96 = w96 - w83; w83 = w19 * w34; w96 = w96 + w83; w96 = load[2] * w96; w33 = w33 + w96;
 w33 = w42 * w33; w12 = w12 - w33; r13 = w12; w12 = w17 * w66; w33 = w71 * w63; w12 = w12 - w33; w33 = w27 * w40;
 w96 = w41 * w89; w33 = w33 - w96; w96 = w28 * w81; w33 = w33 + w96; w33 = load[3] * w33; w12 = w12 + w33;
 w33 = w24 * w81; w96 = w36 * w89; w83 = w19 * w40; w96 = w96 + w83; w33 = w33 - w96; w33 = load[2] * w33;
 w12 = w12 + w33; w33 = w23 * w30; w12 = w12 + w33; w12 = w39 * w12; w71 = w71 * w89; w89 = w23 * w40; w71 = w71 + w89;
 w89 = w17 * w81; w71 = w71 + w89; w41 = w41 * w63; w89 = w28 * w66; w41 = w41 + w89; w89 = w27 * w30; w41 = w41 + w89;
 w41 = load[3] * w41; w71 = w71 - w41; w41 = w19 * w30; w36 = w36 * w63; w63 = w24 * w66; w36 = w36 + w63;
 w41 = w41 - w36; w41 = load[2] * w41; w71 = w71 + w41; w71 = w42 * w71; w12 = w12 - w71; r14 = w12; w12 = w17 * w75;
 w71 = w28 * w52; w41 = w27 * w60; w71 = w71 - w41; w71 = load[3] * w71; w12 = w12 + w71; w71 = w19 * w60;
 w41 = w24 * w52; w71 = w71 + w41; w71 = load[2] * w71; w12 = w12 + w71; w71 = w23 * w5; w12 = w12 + w71;
 w39 = w39 * w12; w12 = w17 * w52; w23 = w23 * w60; w12 = w12 - w23; w28 = w28 * w75; w27 = w27 * w5; w28 = w28 + w27;
 w47 = load[3] * w28; w12 = w12 - w47; w19 = w19 * w5; w47 = w24 * w75; w19 = w19 - w47; w19 = load[2] * w19;
 w12 = w12 + w19; w42 = w42 * w12; w39 = w39 - w42; r15 = w39; w95 = w67 * w95; w39 = w55 * w94; w95 = w95 + w39;
 w58 = w82 * w58; w95 = w95 - w58; w58 = w46 * w87; w95 = w95 - w58; w106 = w50 * w106; w95 = w95 + w106;
 w107 = w56 * w107; w95 = w95 - w107; r16 = w95; w67 = w67 * w51; w95 = w55 * w10; w67 = w67 + w95; w82 = w82 * w48;
 w67 = w67 + w82; w82 = w46 * w3; w67 = w67 - w82; w105 = w50 * w105; w67 = w67 + w105; w114 = w56 * w114;
 w67 = w67 + w114; r17 = w67; w62 = w50 * w62; w55 = w55 * w91; w46 = w46 * w100; w55 = w55 + w46; w62 = w62 - w55;
 w115 = w56 * w115; w62 = w62 - w115; r18 = w62; w85 = w50 * w85; w57 = w56 * w57; w85 = w85 + w57; w85 = -w85;
 r19 = w85; w92 = w92 * w20; w103 = load[26] * w103; w92 = w92 + w103; w103 = load[2] * w15; w92 = w92 + w103;
 w37 = w48 * w37; w92 = w92 - w37; w110 = w51 * w110; w92 = w92 + w110; w111 = load[27] * w111; w92 = w92 + w111;
 w31 = w31 * w14; w92 = w92 + w31; w112 = load[24] * w112; w92 = w92 + w112; w112 = load[0] * w92; w90 = w20 * w90;
 w112 = w112 + w90; w104 = w14 * w104; w112 = w112 + w104; r20 = w112; w112 = load[2] * w21; w104 = load[26] * w24;
 w112 = w112 - w104; w109 = w48 * w109; w112 = w112 - w109; w22 = w51 * w22; w112 = w112 + w22; w22 = load[24] * w17;
 w112 = w112 - w22; w22 = load[0] * w112; w93 = w20 * w93; w22 = w22 + w93; w117 = w14 * w117; w22 = w22 + w117;
 r21 = w22; w22 = load[2] * w43; w66 = w48 * w66; w22 = w22 - w66; w81 = w51 * w81; w22 = w22 + w81;
 w81 = load[0] * w22; w116 = w20 * w116; w81 = w81 + w116; w64 = w14 * w64; w81 = w81 + w64; r22 = w81;
 w81 = load[2] * w68; w75 = w48 * w75; w81 = w81 - w75; w52 = w51 * w52; w81 = w81 + w52; w52 = load[0] * w81;
 w49 = w20 * w49; w52 = w52 + w49; w86 = w14 * w86; w52 = w52 + w86; r23 = w52; w52 = w24 * w4; w92 = w92 + w52;
 w52 = w17 * w113; w92 = w92 + w52; r24 = w92; w92 = w24 * w97; w112 = w112 + w92; w92 = w17 * w59; w112 = w112 + w92;
 r25 = w112; w112 = w24 * w99; w22 = w22 + w112; w112 = w17 * w65; w22 = w22 + w112; r26 = w22; w24 = w24 * w69;
 w81 = w81 + w24; w17 = w17 * w79; w81 = w81 + w17; r27 = w81; w81 = w56 * w6; w15 = w15 - w81; w81 = w50 * w8;
 w15 = w15 + w81; r28 = w15; w15 = w56 * w74; w21 = w21 - w15; w15 = w50 * w34; w21 = w21 + w15; r29 = w21;
 w21 = w56 * w40; w43 = w43 - w21; w21 = w50 * w30; w43 = w43 + w21; r30 = w43; w56 = w56 * w60; w68 = w68 + w56;
 w50 = w50 * w5; w68 = w68 + w50; r31 = w68; w94 = w88 * w94; w87 = w80 * w87; w94 = w94 + w87; r32 = w94;
 w10 = w88 * w10; w3 = w80 * w3; w10 = w10 + w3; r33 = w10; w80 = w80 * w100; w88 = w88 * w91; w80 = w80 - w88;
 r34 = w80; w80 = load[27] * load[0]; w32 = load[24] * w20; w80 = w80 - w32; w32 = load[2] * w2; w80 = w80 + w32;
 w6 = w51 * w6; w80 = w80 + w6; w8 = w48 * w8; w80 = w80 - w8; w25 = load[26] * w14; w80 = w80 + w25;
 w25 = load[0] * w80; w4 = w14 * w4; w25 = w25 + w4; w113 = w20 * w113; w25 = w25 - w113; w25 = w25 + load[21];
 r35 = w25; w25 = load[2] * w29; w35 = load[27] + w25; w74 = w51 * w74; w35 = w35 + w74; w34 = w48 * w34;
 w35 = w35 - w34; w34 = load[0] * w35; w97 = w14 * w97; w34 = w34 + w97; w59 = w20 * w59; w34 = w34 - w59; r36 = w34;
 w44 = load[2] * w61; w40 = w51 * w40; w44 = w44 + w40; w30 = w48 * w30; w44 = w44 - w30; w30 = load[0] * w44;
 w99 = w14 * w99; w30 = w30 + w99; w65 = w20 * w65; w30 = w30 - w65; r37 = w30; w14 = w14 * w69; w51 = w51 * w60;
 w48 = w48 * w5; w51 = w51 + w48; w26 = load[0] * w51; w14 = w14 - w26; w20 = w20 * w79; w14 = w14 - w20; r38 = w14;
 r39 = w80; r40 = w35; r41 = w44; w51 = -w51; r42 = w51; r43 = w2; r44 = w29; r45 = w61; r46 = w98; w101 = -w101;
 r47 = w101; r48 = load[34]; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3; by[0] = r4; by[12] = r5; by[24] = r6;
 by[36] = r7; by[1] = r8; by[13] = r9; by[25] = r10; by[37] = r11; by[2] = r12; by[14] = r13; by[26] = r14;
 by[38] = r15; by[3] = r16; by[15] = r17; by[27] = r18; by[39] = r19; by[4] = r20; by[16] = r21; by[28] = r22;
 by[40] = r23; by[5] = r24; by[17] = r25; by[29] = r26; by[41] = r27; by[6] = r28; by[18] = r29; by[30] = r30;
 by[42] = r31; by[7] = r32; by[19] = r33; by[31] = r34; by[8] = r35; by[20] = r36; by[32] = r37; by[44] = r38;
 by[9] = r39; by[21] = r40; by[33] = r41; by[45] = r42; by[10] = r43; by[22] = r44; by[34] = r45; by[11] = r46;
 by[23] = r47; by[47] = r48;
}

static void torques_bend(const real *load, const real *y, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23;
 real w24, w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35;
 real w36, w37, w38, w39, w40, w41, w42, w43, w44, w45, w46, w47;
 real w48, w49, w50, w51, w52, w53, w54, w55, w56, w57, w58, w59;
 real w60, w61, w62, w63, w64, w65, w66, w67, w68, w69, w70, w71;
 real w72, w73, w74, w75, w76, w77, w78, w79, w80, w81, w82, w83;
 real w84, w85, w86, w87, w88, w89, w90, w91, w92, w93, w94, w95;
 real w96, w97, w98, w99, w100, w101, w102, w103, w104, w105, w106, w107;
 real w108, w109, w110, w111, w112, w113, w114, w115, w116, w117, w118, w119;
 real w120, w121, w122, w123, w124, w125, w126, w127, w128, w129, w130, w131;
 real w132, w133, w134, w135, w136, w137, w138, w139, w140, w141, w142, w143;
 real w144, w145, w146, w147, w148, w149, w150, w151, w152, w153, w154, w155;
 real w156, w157, w158, w159, w160, w161, w162, w163, w164, w165, w166, w167;
 real w168, w169, w170, w171, w172, w173, r0, r1, r2, r3, r4, r5;
 real r6, r7, r8, r9, r10, r11, r12, r13, r14, r15, r16, r17;
 real r18, r19, r20, r21, r22, r23, r24, r25, r26, r27, r28, r29;
 real r30, r31, r32, r33, r34, r35, r36, r37, r38, r39, r40; w3 = V(sin)(y[1]); w4 = load[0] * w3;
 w8 = load[0] * lam[0]; w6 = lam[1] + w8; w8 = load[10] * w6; w2 = V(cos)(y[1]); w11 = load[1] * w2; w12 = w11 * lam[0];
 w13 = load[12] * w12; w8 = w8 + w13; w14 = V(sin)(y[2]); w16 = load[37] + y[3]; w18 = load[3] * w14; w19 = w18 * w6;
 w21 = load[2] * w14; w22 = w21 * w12; w19 = w19 + w22; w13 = V(cos)(y[2]); w22 = load[1] * w3; w23 = w22 * lam[0];
 w24 = w13 * w23; w19 = w19 + w24; w24 = w16 * w19; w27 = load[2] * w6; w26 = lam[2] + w27; w27 = load[3] * w12;
 w26 = w26 - w27; w27 = load[36] * w26; w24 = w24 - w27; w24 = load[34] * w24; w28 = load[14] * w26; w28 = w24 - w28;
 w30 = load[15] * w19; w28 = w28 + w30; w30 = w14 * w28; w8 = w8 + w30; w31 = load[13] * w26; w33 = load[35] * w26;
 w34 = w14 * w23; w35 = load[3] * w13; w36 = w35 * w6; w37 = load[2] * w13; w38 = w37 * w12; w36 = w36 + w38;
 w34 = w34 - w36; w36 = w16 * w34; w33 = w33 - w36; w33 = load[34] * w33; w31 = w31 + w33; w36 = load[15] * w34;
 w31 = w31 - w36; w36 = w13 * w31; w8 = w8 + w36; w36 = w4 * w8; w39 = load[11] * w12; w40 = w35 * w28; w39 = w39 + w40;
 w40 = w18 * w31; w39 = w39 - w40; w41 = load[35] * w19; w40 = lam[3] - w41; w41 = load[36] * w34; w40 = w40 + w41;
 w40 = load[34] * w40; w41 = load[13] * w19; w41 = w40 - w41; w42 = load[14] * w34; w41 = w41 + w42;
 w42 = load[2] * w41; w39 = w39 - w42; w42 = load[10] * w23; w39 = w39 + w42; w39 = load[1] * w39; w36 = w36 + w39;
 w39 = load[0] * w2; w42 = w37 * w28; w43 = load[11] * w6; w42 = w42 - w43; w43 = w21 * w31; w42 = w42 - w43;
 w41 = load[3] * w41; w42 = w42 + w41; w41 = load[12] * w23; w42 = w42 + w41; w41 = w39 * w42; w36 = w36 - w41;
 w41 = load[8] * lam[0]; w36 = w36 + w41; w41 = load[5] * w36; w44 = w2 * w8; w45 = w3 * w42; w44 = w44 + w45;
 w45 = load[7] * lam[0]; w44 = w44 + w45; w45 = load[4] * w44; w41 = w41 + w45; w46 = V(sin)(y[0]); w41 = w41 * w46;
 w36 = load[4] * w36; w44 = load[5] * w44; w36 = w36 - w44; w45 = V(cos)(y[0]); w36 = w36 * w45; w41 = w41 + w36;
 w41 = -w41; r0 = w41; w41 = w8 * w39; w36 = lam[0] * w11; w44 = w13 * w36; w47 = lam[0] * w22; w48 = w21 * w47;
 w44 = w44 - w48; w48 = w16 * w44; w49 = load[3] * w47; w50 = load[36] * w49; w48 = w48 - w50; w48 = load[34] * w48;
 w50 = load[14] * w49; w50 = w48 - w50; w51 = load[15] * w44; w50 = w50 + w51; w51 = w14 * w50; w52 = load[12] * w47;
 w51 = w51 - w52; w52 = load[13] * w49; w53 = load[35] * w49; w54 = w14 * w36; w55 = w37 * w47; w54 = w54 + w55;
 w55 = w16 * w54; w53 = w53 - w55; w53 = load[34] * w53; w52 = w52 + w53; w55 = load[15] * w54; w52 = w52 - w55;
 w55 = w13 * w52; w51 = w51 + w55; w55 = w4 * w51; w41 = w41 + w55; w55 = w35 * w50; w56 = load[11] * w47;
 w55 = w55 - w56; w56 = w18 * w52; w55 = w55 - w56; w56 = load[36] * w54; w57 = load[35] * w44; w56 = w56 - w57;
 w56 = load[34] * w56; w57 = load[13] * w44; w57 = w56 - w57; w58 = load[14] * w54; w57 = w57 + w58;
 w58 = load[2] * w57; w55 = w55 - w58; w58 = load[10] * w36; w55 = w55 + w58; w55 = load[1] * w55; w41 = w41 + w55;
 w50 = w37 * w50; w52 = w21 * w52; w50 = w50 - w52; w57 = load[3] * w57; w50 = w50 + w57; w57 = load[12] * w36;
 w50 = w50 + w57; w57 = w39 * w50; w52 = w42 * w4; w57 = w57 - w52; w41 = w41 - w57; w57 = load[5] * w41;
 w52 = w2 * w51; w55 = w8 * w3; w52 = w52 - w55; w55 = w42 * w2; w58 = w3 * w50; w55 = w55 + w58; w52 = w52 + w55;
 w55 = load[4] * w52; w57 = w57 + w55; w57 = w45 * w57; w41 = load[4] * w41; w52 = load[5] * w52; w41 = w41 - w52;
 w41 = w46 * w41; w57 = w57 - w41; r1 = w57; w57 = w45 * load[4]; w41 = w46 * load[5]; w57 = w57 + w41; w41 = w57 * w51;
 w41 = load[0] * w41; w52 = w46 * load[4]; w55 = w45 * load[5]; w52 = w52 - w55; w55 = w52 * w50; w41 = w41 + w55;
 w60 = y[4] * w11; w61 = y[5] * w60; w63 = y[8] * w22; w61 = w61 + w63; w63 = load[23] * w61; w65 = y[8] * w11;
 w66 = y[4] * w22; w67 = y[5] * w66; w65 = w65 - w67; w67 = load[25] * w65; w63 = w63 + w67; w67 = load[0] * y[4];
 w67 = w67 + y[5]; w68 = load[23] * w60; w70 = load[22] * w66; w68 = w68 + w70; w70 = w67 * w68; w71 = w11 * y[4];
 w73 = load[26] * w60; w75 = load[24] * w66; w73 = w73 + w75; w75 = w71 * w73; w76 = w22 * y[4]; w77 = load[26] * w76;
 w78 = load[24] * w71; w77 = w77 - w78; w79 = load[27] * w67; w77 = w77 + w79; w79 = w77 * w66; w75 = w75 - w79;
 w70 = w70 + w75; w63 = w63 + w70; w70 = w52 * w2; w75 = w57 * w4; w70 = w70 + w75; w79 = load[6] * w22;
 w70 = w70 - w79; w79 = load[12] * w70; w63 = w63 + w79; w80 = w37 * w61; w81 = w14 * w65; w80 = w80 + w81;
 w82 = w13 * w60; w83 = w21 * w66; w82 = w82 - w83; w83 = y[6] * w82; w80 = w80 + w83; w83 = load[28] * w80;
 w85 = w13 * w65; w86 = w21 * w61; w85 = w85 - w86; w86 = w14 * w60; w87 = w37 * w66; w86 = w86 + w87; w87 = y[6] * w86;
 w85 = w85 - w87; w87 = load[29] * w85; w83 = w83 + w87; w88 = load[3] * w61; w89 = load[30] * w88; w83 = w83 + w89;
 w89 = w14 * w76; w90 = w37 * w71; w89 = w89 - w90; w90 = w35 * w67; w89 = w89 - w90; w90 = load[30] * w89;
 w92 = w21 * w71; w93 = w13 * w76; w92 = w92 + w93; w93 = w18 * w67; w92 = w92 + w93; w93 = load[32] * w92;
 w90 = w90 + w93; w94 = load[2] * w67; w95 = load[3] * w71; w94 = w94 - w95; w94 = w94 + y[6]; w95 = load[33] * w94;
 w90 = w90 + w95; w95 = w90 * w82; w96 = load[30] * w86; w97 = load[32] * w82; w96 = w96 + w97; w97 = load[3] * w66;
 w98 = load[33] * w97; w96 = w96 + w98; w98 = w92 * w96; w95 = w95 + w98; w98 = load[29] * w89; w100 = load[31] * w92;
 w98 = w98 + w100; w100 = load[32] * w94; w98 = w98 + w100; w100 = w98 * w97; w101 = load[29] * w86;
 w102 = load[31] * w82; w101 = w101 + w102; w102 = load[32] * w97; w101 = w101 + w102; w102 = w94 * w101;
 w100 = w100 + w102; w95 = w95 - w100; w83 = w83 + w95; w95 = load[3] * w70; w100 = load[14] * w95; w102 = w57 * w39;
 w103 = w52 * w3; w102 = w102 - w103; w103 = load[6] * w11; w102 = w102 - w103; w103 = w13 * w102; w104 = w21 * w70;
 w103 = w103 - w104; w104 = load[15] * w103; w100 = w100 - w104; w83 = w83 + w100; w100 = load[36] * w80;
 w104 = load[35] * w85; w100 = w100 - w104; w100 = w95 + w100; w104 = w94 * load[35]; w105 = w89 * w16;
 w104 = w104 - w105; w105 = w104 * w86; w106 = load[35] * w97; w107 = w16 * w86; w106 = w106 - w107; w107 = w89 * w106;
 w105 = w105 + w107; w107 = w92 * w16; w108 = w94 * load[36]; w107 = w107 - w108; w108 = w107 * w82; w109 = w16 * w82;
 w110 = load[36] * w97; w109 = w109 - w110; w110 = w92 * w109; w108 = w108 + w110; w105 = w105 - w108;
 w100 = w100 + w105; w100 = load[34] * w100; w105 = load[36] * w100; w110 = -w86; w110 = R(2.0) * w110;
 w111 = y[7] * w110; w111 = w103 + w111; w112 = load[35] * w88; w113 = w16 * w80; w112 = w112 - w113;
 w111 = w111 + w112; w112 = w107 * w97; w113 = w94 * w109; w112 = w112 + w113; w113 = w89 * load[36];
 w114 = w92 * load[35]; w113 = w113 - w114; w114 = w113 * w86; w115 = load[36] * w86; w116 = load[35] * w82;
 w115 = w115 - w116; w116 = w89 * w115; w114 = w114 + w116; w112 = w112 - w114; w111 = w111 + w112;
 w111 = load[34] * w111; w112 = w16 * w111; w105 = w105 - w112; w83 = w83 + w105; w105 = w14 * w83;
 w112 = load[29] * w80; w114 = load[31] * w85; w112 = w112 + w114; w114 = load[32] * w88; w112 = w112 + w114;
 w114 = load[28] * w89; w116 = load[29] * w92; w114 = w114 + w116; w116 = load[30] * w94; w114 = w114 + w116;
 w116 = w114 * w97; w117 = load[28] * w86; w118 = load[29] * w82; w117 = w117 + w118; w118 = load[30] * w97;
 w117 = w117 + w118; w118 = w94 * w117; w116 = w116 + w118; w118 = w90 * w86; w119 = w89 * w96; w118 = w118 + w119;
 w116 = w116 - w118; w112 = w112 + w116; w70 = w37 * w70; w116 = w14 * w102; w70 = w70 + w116; w116 = load[15] * w70;
 w95 = load[13] * w95; w116 = w116 - w95; w112 = w112 + w116; w116 = R(2.0) * w82; w95 = y[7] * w116; w95 = w70 + w95;
 w118 = w16 * w85; w119 = load[36] * w88; w118 = w118 - w119; w95 = w95 + w118; w118 = w113 * w82; w119 = w92 * w115;
 w118 = w118 + w119; w119 = w104 * w97; w120 = w94 * w106; w119 = w119 + w120; w118 = w118 - w119; w95 = w95 + w118;
 w95 = load[34] * w95; w118 = w16 * w95; w100 = load[35] * w100; w118 = w118 - w100; w112 = w112 + w118;
 w118 = w13 * w112; w105 = w105 + w118; w63 = w63 + w105; w63 = lam[0] * w63; w105 = load[6] * w51; w63 = w63 - w105;
 w105 = load[23] * w47; w118 = load[32] * w49; w100 = w16 * w48; w118 = w118 + w100; w100 = load[31] * w44;
 w118 = w118 + w100; w100 = load[35] * w56; w118 = w118 - w100; w100 = load[29] * w54; w118 = w118 + w100;
 w100 = w13 * w118; w105 = w105 + w100; w100 = load[30] * w49; w119 = load[29] * w44; w100 = w100 + w119;
 w119 = w16 * w53; w100 = w100 - w119; w119 = load[36] * w56; w100 = w100 + w119; w119 = load[28] * w54;
 w100 = w100 + w119; w119 = w14 * w100; w105 = w105 + w119; w119 = load[25] * w36; w105 = w105 + w119;
 w119 = y[8] * w105; w63 = w63 + w119; w119 = w6 * w66; w120 = w67 * w47; w119 = w119 - w120; w120 = load[25] * w119;
 w121 = w6 * w68; w120 = w120 - w121; w121 = w12 * w73; w122 = w77 * w47; w121 = w121 - w122; w120 = w120 - w121;
 w121 = w26 * w101; w122 = w98 * w49; w121 = w121 + w122; w122 = w19 * w96; w123 = w90 * w44; w122 = w122 + w123;
 w121 = w121 - w122; w122 = w19 * w97; w123 = w94 * w44; w122 = w122 + w123; w123 = w26 * w82; w124 = w92 * w49;
 w123 = w123 + w124; w122 = w122 - w123; w123 = load[28] * w122; w121 = w121 + w123; w123 = w33 * w115;
 w124 = w113 * w53; w123 = w123 + w124; w121 = w121 - w123; w123 = w24 * w82; w124 = w92 * w48; w123 = w123 + w124;
 w124 = w33 * w86; w125 = w89 * w53; w124 = w124 + w125; w123 = w123 - w124; w124 = load[36] * w123; w121 = w121 + w124;
 w124 = y[7] * w53; w124 = R(2.0) * w124; w121 = w121 - w124; w124 = w40 * w106; w125 = w104 * w56; w124 = w124 + w125;
 w121 = w121 + w124; w124 = w40 * w86; w125 = w89 * w56; w124 = w124 + w125; w125 = w24 * w97; w126 = w94 * w48;
 w125 = w125 + w126; w124 = w124 - w125; w125 = w16 * w124; w121 = w121 - w125; w125 = w26 * w86; w126 = w89 * w49;
 w125 = w125 + w126; w126 = w34 * w97; w127 = w94 * w54; w126 = w126 + w127; w125 = w125 - w126; w126 = load[29] * w125;
 w121 = w121 + w126; w126 = w34 * w82; w127 = w92 * w54; w126 = w126 + w127; w127 = w19 * w86; w128 = w89 * w44;
 w127 = w127 + w128; w126 = w126 - w127; w127 = load[30] * w126; w121 = w121 + w127; w127 = y[6] * w118;
 w121 = w121 - w127; w127 = w14 * w121; w120 = w120 + w127; w115 = w24 * w115; w127 = w113 * w48; w115 = w115 + w127;
 w127 = w26 * w117; w128 = w114 * w49; w127 = w127 + w128; w115 = w115 - w127; w127 = y[7] * w48; w127 = R(2.0) * w127;
 w115 = w115 + w127; w127 = load[29] * w122; w115 = w115 + w127; w123 = load[35] * w123; w115 = w115 - w123;
 w123 = w40 * w109; w127 = w107 * w56; w123 = w123 + w127; w115 = w115 - w123; w97 = w33 * w97; w123 = w94 * w53;
 w97 = w97 + w123; w123 = w40 * w82; w127 = w92 * w56; w123 = w123 + w127; w97 = w97 - w123; w123 = w16 * w97;
 w115 = w115 + w123; w123 = load[31] * w125; w115 = w115 + w123; w96 = w34 * w96; w123 = w90 * w54; w96 = w96 + w123;
 w115 = w115 + w96; w96 = load[32] * w126; w115 = w115 + w96; w96 = y[6] * w100; w115 = w115 + w96; w96 = w13 * w115;
 w120 = w120 + w96; w96 = w71 * w36; w123 = w23 * w66; w96 = w96 - w123; w123 = w12 * w60; w127 = w76 * w47;
 w123 = w123 - w127; w96 = w96 - w123; w123 = load[26] * w96; w120 = w120 + w123; w123 = w67 * w36; w127 = w6 * w60;
 w123 = w123 - w127; w127 = load[23] * w123; w120 = w120 + w127; w127 = load[22] * w47; w49 = load[33] * w49;
 w128 = load[36] * w48; w49 = w49 - w128; w128 = load[32] * w44; w49 = w49 + w128; w128 = load[35] * w53;
 w49 = w49 + w128; w128 = load[30] * w54; w49 = w49 + w128; w128 = load[3] * w49; w127 = w127 + w128; w128 = w21 * w118;
 w127 = w127 - w128; w128 = w37 * w100; w127 = w127 + w128; w128 = load[23] * w36; w127 = w127 + w128;
 w128 = y[5] * w127; w120 = w120 + w128; w128 = y[4] * w120; w63 = w63 + w128; w63 = load[1] * w63; w41 = w41 + w63;
 w41 = w2 * w41; w63 = w57 * w8; w63 = load[0] * w63; w128 = w52 * w42; w63 = w63 + w128; w128 = w76 * y[5];
 w129 = w11 * y[8]; w128 = w128 - w129; w129 = load[23] * w128; w130 = w22 * y[8]; w131 = w71 * y[5];
 w130 = w130 + w131; w131 = load[25] * w130; w129 = w129 + w131; w131 = load[0] * y[8]; w131 = w131 + y[9];
 w132 = load[26] * w131; w129 = w129 + w132; w132 = load[23] * w76; w133 = load[22] * w71; w133 = w132 - w133;
 w134 = load[24] * w67; w133 = w133 + w134; w134 = w67 * w133; w135 = w71 * w77; w134 = w134 + w135; w129 = w129 + w134;
 w134 = w3 * w52; w135 = w39 * w57; w134 = w134 - w135; w135 = w11 * load[6]; w134 = w134 + w135;
 w135 = load[12] * w134; w136 = load[1] * w57; w137 = load[0] * load[6]; w136 = w136 + w137; w5 = load[10] * w136;
 w135 = w135 + w5; w129 = w129 + w135; w135 = w37 * w128; w5 = w14 * w130; w135 = w135 + w5; w5 = w35 * w131;
 w135 = w135 - w5; w5 = w92 * y[6]; w135 = w135 + w5; w5 = load[28] * w135; w137 = w13 * w130; w138 = w21 * w128;
 w137 = w137 - w138; w138 = w18 * w131; w137 = w137 + w138; w138 = w89 * y[6]; w137 = w137 - w138;
 w138 = load[29] * w137; w5 = w5 + w138; w138 = load[3] * w128; w139 = load[2] * w131; w138 = w138 + w139;
 w138 = w138 + y[10]; w139 = load[30] * w138; w5 = w5 + w139; w139 = w92 * w90; w140 = w94 * w98; w139 = w139 - w140;
 w5 = w5 + w139; w139 = load[3] * w134; w140 = load[2] * w136; w139 = w139 - w140; w140 = load[14] * w139;
 w141 = w4 * w57; w142 = w2 * w52; w141 = w141 + w142; w142 = w22 * load[6]; w141 = w141 - w142; w142 = w13 * w141;
 w143 = w21 * w134; w142 = w142 - w143; w143 = w18 * w136; w142 = w142 - w143; w143 = load[15] * w142;
 w140 = w140 - w143; w5 = w5 + w140; w140 = w139 + y[11]; w143 = w135 * load[36]; w144 = w137 * load[35];
 w143 = w143 - w144; w140 = w140 + w143; w143 = w89 * w104; w144 = w92 * w107; w143 = w143 - w144; w140 = w140 + w143;
 w140 = load[34] * w140; w143 = load[36] * w140; w144 = -w89; w144 = R(2.0) * w144; w145 = w144 * y[7];
 w145 = w142 + w145; w146 = w138 * load[35]; w147 = w135 * w16; w146 = w146 - w147; w145 = w145 + w146;
 w146 = w94 * w107; w147 = w89 * w113; w146 = w146 - w147; w145 = w145 + w146; w145 = load[34] * w145;
 w146 = w16 * w145; w143 = w143 - w146; w5 = w5 + w143; w143 = w14 * w5; w146 = load[29] * w135; w147 = load[31] * w137;
 w146 = w146 + w147; w147 = load[32] * w138; w146 = w146 + w147; w147 = w94 * w114; w148 = w89 * w90;
 w147 = w147 - w148; w146 = w146 + w147; w147 = w37 * w134; w148 = w14 * w141; w147 = w147 + w148; w148 = w35 * w136;
 w147 = w147 + w148; w148 = load[15] * w147; w139 = load[13] * w139; w148 = w148 - w139; w146 = w146 + w148;
 w148 = R(2.0) * w92; w139 = w148 * y[7]; w139 = w147 + w139; w149 = w137 * w16; w150 = w138 * load[36];
 w149 = w149 - w150; w139 = w139 + w149; w149 = w92 * w113; w150 = w94 * w104; w149 = w149 - w150; w139 = w139 + w149;
 w139 = load[34] * w139; w149 = w16 * w139; w140 = load[35] * w140; w149 = w149 - w140; w146 = w146 + w149;
 w149 = w13 * w146; w143 = w143 + w149; w129 = w129 + w143; w129 = w129 * lam[0]; w143 = load[6] * w8;
 w129 = w129 - w143; w143 = load[26] * w6; w149 = load[23] * w12; w143 = w143 - w149; w140 = load[32] * w26;
 w150 = w16 * w24; w140 = w140 + w150; w150 = load[31] * w19; w140 = w140 + w150; w150 = load[35] * w40;
 w140 = w140 - w150; w150 = load[29] * w34; w140 = w140 + w150; w150 = w13 * w140; w143 = w143 + w150;
 w150 = load[30] * w26; w151 = load[29] * w19; w150 = w150 + w151; w151 = w16 * w33; w150 = w150 - w151;
 w151 = load[36] * w40; w150 = w150 + w151; w151 = load[28] * w34; w150 = w150 + w151; w151 = w14 * w150;
 w143 = w143 + w151; w151 = load[25] * w23; w143 = w143 + w151; w151 = y[8] * w143; w129 = w129 + w151;
 w151 = w67 * w12; w152 = w71 * w6; w151 = w151 - w152; w152 = load[25] * w151; w153 = w133 * w6; w152 = w152 - w153;
 w153 = w77 * w12; w152 = w152 - w153; w153 = w98 * w26; w154 = w90 * w19; w153 = w153 - w154; w154 = w94 * w19;
 w155 = w92 * w26; w154 = w154 - w155; w155 = load[28] * w154; w153 = w153 + w155; w155 = w113 * w33;
 w153 = w153 - w155; w155 = w92 * w24; w156 = w89 * w33; w155 = w155 - w156; w156 = load[36] * w155; w153 = w153 + w156;
 w156 = y[7] * w33; w156 = R(2.0) * w156; w153 = w153 - w156; w156 = w104 * w40; w153 = w153 + w156; w156 = w89 * w40;
 w157 = w94 * w24; w156 = w156 - w157; w157 = w16 * w156; w153 = w153 - w157; w157 = w89 * w26; w158 = w94 * w34;
 w157 = w157 - w158; w158 = load[29] * w157; w153 = w153 + w158; w158 = w92 * w34; w159 = w89 * w19; w158 = w158 - w159;
 w159 = load[30] * w158; w153 = w153 + w159; w159 = y[6] * w140; w153 = w153 - w159; w159 = w14 * w153;
 w152 = w152 + w159; w159 = w113 * w24; w160 = w114 * w26; w159 = w159 - w160; w160 = y[7] * w24; w160 = R(2.0) * w160;
 w159 = w159 + w160; w160 = load[29] * w154; w159 = w159 + w160; w155 = load[35] * w155; w159 = w159 - w155;
 w155 = w107 * w40; w159 = w159 - w155; w155 = w94 * w33; w160 = w92 * w40; w155 = w155 - w160; w160 = w16 * w155;
 w159 = w159 + w160; w160 = load[31] * w157; w159 = w159 + w160; w160 = w90 * w34; w159 = w159 + w160;
 w160 = load[32] * w158; w159 = w159 + w160; w160 = y[6] * w150; w159 = w159 + w160; w160 = w13 * w159;
 w152 = w152 + w160; w160 = w71 * w23; w161 = w76 * w12; w160 = w160 - w161; w161 = load[26] * w160; w152 = w152 + w161;
 w161 = w67 * w23; w162 = w76 * w6; w161 = w161 - w162; w162 = load[23] * w161; w152 = w152 + w162;
 w162 = load[24] * w6; w163 = load[22] * w12; w162 = w162 - w163; w163 = load[33] * w26; w164 = load[36] * w24;
 w163 = w163 - w164; w164 = load[32] * w19; w163 = w163 + w164; w164 = load[35] * w33; w163 = w163 + w164;
 w164 = load[30] * w34; w163 = w163 + w164; w163 = load[3] * w163; w162 = w162 + w163; w163 = w21 * w140;
 w162 = w162 - w163; w163 = w37 * w150; w162 = w162 + w163; w163 = load[23] * w23; w162 = w162 + w163;
 w164 = y[5] * w162; w152 = w152 + w164; w164 = y[4] * w152; w129 = w129 + w164; w129 = load[1] * w129;
 w63 = w63 + w129; w63 = w63 * w3; w41 = w41 - w63; w8 = w52 * w8; w63 = w57 * w42; w63 = load[0] * w63; w8 = w8 - w63;
 w42 = load[6] * w42; w63 = load[22] * w128; w129 = load[23] * w130; w63 = w63 + w129; w129 = load[24] * w131;
 w63 = w63 + w129; w129 = w76 * w77; w164 = load[25] * w76; w165 = load[23] * w71; w164 = w164 - w165;
 w166 = load[26] * w67; w164 = w164 + w166; w166 = w67 * w164; w129 = w129 - w166; w63 = w63 + w129;
 w38 = load[11] * w136; w129 = load[12] * w141; w38 = w38 + w129; w63 = w63 - w38; w38 = w37 * w5; w129 = w21 * w146;
 w38 = w38 - w129; w129 = load[30] * w135; w166 = load[32] * w137; w129 = w129 + w166; w138 = load[33] * w138;
 w129 = w129 + w138; w138 = w89 * w98; w166 = w92 * w114; w138 = w138 - w166; w129 = w129 + w138;
 w142 = load[13] * w142; w147 = load[14] * w147; w142 = w142 - w147; w129 = w129 + w142; w142 = load[35] * w145;
 w147 = load[36] * w139; w142 = w142 - w147; w129 = w129 + w142; w129 = load[3] * w129; w38 = w38 + w129;
 w63 = w63 + w38; w63 = w63 * lam[0]; w42 = w42 - w63; w63 = w21 * w159; w38 = w164 * w6; w151 = load[23] * w151;
 w38 = w38 + w151; w151 = w114 * w19; w129 = w104 * w24; w151 = w151 - w129; w154 = load[30] * w154; w151 = w151 + w154;
 w154 = w107 * w33; w151 = w151 + w154; w154 = load[36] * w155; w151 = w151 - w154; w154 = load[35] * w156;
 w151 = w151 + w154; w154 = w98 * w34; w151 = w151 - w154; w157 = load[32] * w157; w151 = w151 + w157;
 w158 = load[33] * w158; w151 = w151 + w158; w151 = load[3] * w151; w38 = w38 + w151; w151 = w37 * w153;
 w38 = w38 + w151; w63 = w63 - w38; w38 = w77 * w23; w63 = w63 + w38; w160 = load[24] * w160; w63 = w63 - w160;
 w161 = load[22] * w161; w63 = w63 - w161; w161 = y[5] * w143; w63 = w63 + w161; w161 = y[4] * w63; w42 = w42 + w161;
 w161 = y[8] * w162; w42 = w42 - w161; w42 = load[1] * w42; w8 = w8 + w42; w8 = w8 * w2; w51 = w52 * w51;
 w42 = w57 * w50; w42 = load[0] * w42; w51 = w51 - w42; w50 = load[6] * w50; w61 = load[22] * w61; w65 = load[23] * w65;
 w61 = w61 + w65; w65 = w77 * w60; w42 = w76 * w73; w65 = w65 + w42; w60 = load[25] * w60; w66 = load[23] * w66;
 w60 = w60 + w66; w66 = w67 * w60; w65 = w65 - w66; w61 = w61 + w65; w9 = load[12] * w102; w61 = w61 - w9;
 w83 = w37 * w83; w112 = w21 * w112; w83 = w83 - w112; w112 = load[30] * w80; w9 = load[32] * w85; w112 = w112 + w9;
 w88 = load[33] * w88; w112 = w112 + w88; w88 = w98 * w86; w9 = w89 * w101; w88 = w88 + w9; w9 = w114 * w82;
 w102 = w92 * w117; w9 = w9 + w102; w88 = w88 - w9; w112 = w112 + w88; w103 = load[13] * w103; w70 = load[14] * w70;
 w103 = w103 - w70; w112 = w112 + w103; w103 = load[35] * w111; w70 = load[36] * w95; w103 = w103 - w70;
 w112 = w112 + w103; w112 = load[3] * w112; w83 = w83 + w112; w61 = w61 + w83; w61 = lam[0] * w61; w50 = w50 - w61;
 w61 = w21 * w115; w83 = w6 * w60; w112 = load[23] * w119; w83 = w83 + w112; w117 = w19 * w117; w112 = w114 * w44;
 w117 = w117 + w112; w106 = w24 * w106; w112 = w104 * w48; w106 = w106 + w112; w117 = w117 - w106;
 w122 = load[30] * w122; w117 = w117 + w122; w109 = w33 * w109; w122 = w107 * w53; w109 = w109 + w122;
 w117 = w117 + w109; w109 = load[36] * w97; w117 = w117 - w109; w109 = load[35] * w124; w117 = w117 + w109;
 w101 = w34 * w101; w109 = w98 * w54; w101 = w101 + w109; w117 = w117 - w101; w125 = load[32] * w125;
 w117 = w117 + w125; w126 = load[33] * w126; w117 = w117 + w126; w126 = load[3] * w117; w83 = w83 + w126;
 w126 = w37 * w121; w83 = w83 + w126; w61 = w61 - w83; w73 = w23 * w73; w77 = w77 * w36; w73 = w73 + w77;
 w61 = w61 + w73; w73 = load[24] * w96; w61 = w61 - w73; w73 = load[22] * w123; w61 = w61 - w73; w73 = y[5] * w105;
 w61 = w61 + w73; w73 = y[4] * w61; w50 = w50 + w73; w73 = y[8] * w127; w50 = w50 - w73; w50 = load[1] * w50;
 w51 = w51 + w50; w51 = w3 * w51; w8 = w8 + w51; w41 = w41 - w8; r2 = w41; w41 = w28 * w13; w8 = w6 * w35;
 w51 = w12 * w37; w8 = w8 + w51; w51 = w23 * w14; w8 = w8 - w51; w51 = w16 * w8; w51 = load[34] * w51;
 w50 = load[15] * w8; w50 = w51 + w50; w73 = w14 * w50; w41 = w41 + w73; w73 = w31 * w14; w77 = w23 * w13;
 w83 = w6 * w18; w126 = w12 * w21; w83 = w83 + w126; w77 = w77 + w83; w83 = w16 * w77; w83 = load[34] * w83;
 w126 = load[15] * w77; w126 = w83 + w126; w125 = w13 * w126; w73 = w73 + w125; w41 = w41 - w73; w73 = w4 * w41;
 w125 = w35 * w50; w101 = w28 * w18; w125 = w125 - w101; w101 = w31 * w35; w109 = w18 * w126; w101 = w101 - w109;
 w125 = w125 - w101; w101 = load[36] * w77; w109 = load[35] * w8; w101 = w101 - w109; w101 = load[34] * w101;
 w109 = load[13] * w8; w109 = w101 - w109; w122 = load[14] * w77; w109 = w109 + w122; w122 = load[2] * w109;
 w125 = w125 - w122; w125 = load[1] * w125; w73 = w73 + w125; w125 = w37 * w50; w122 = w28 * w21; w125 = w125 - w122;
 w122 = w31 * w37; w106 = w21 * w126; w122 = w122 - w106; w125 = w125 - w122; w109 = load[3] * w109; w125 = w125 + w109;
 w109 = w39 * w125; w73 = w73 - w109; w109 = load[5] * w73; w122 = w2 * w41; w106 = w3 * w125; w122 = w122 + w106;
 w106 = load[4] * w122; w109 = w109 + w106; w109 = w45 * w109; w73 = load[4] * w73; w122 = load[5] * w122;
 w73 = w73 - w122; w73 = w46 * w73; w109 = w109 - w73; r3 = w109; w109 = w57 * w41; w109 = load[0] * w109;
 w73 = w52 * w125; w109 = w109 + w73; w73 = w5 * w13; w122 = w130 * w13; w106 = w128 * w21; w122 = w122 - w106;
 w106 = w131 * w18; w122 = w122 + w106; w106 = w71 * w37; w112 = w76 * w14; w106 = w106 - w112; w112 = w67 * w35;
 w106 = w106 + w112; w112 = y[6] * w106; w122 = w122 + w112; w112 = load[28] * w122; w103 = w131 * w35;
 w70 = w130 * w14; w88 = w128 * w37; w70 = w70 + w88; w103 = w103 - w70; w70 = w76 * w13; w88 = w71 * w21;
 w70 = w70 + w88; w88 = w67 * w18; w70 = w70 + w88; w88 = y[6] * w70; w103 = w103 - w88; w88 = load[29] * w103;
 w112 = w112 + w88; w88 = w90 * w106; w9 = load[30] * w70; w102 = load[32] * w106; w9 = w9 + w102; w102 = w92 * w9;
 w88 = w88 + w102; w102 = load[29] * w70; w65 = load[31] * w106; w102 = w102 + w65; w65 = w94 * w102; w88 = w88 - w65;
 w112 = w112 + w88; w88 = w141 * w14; w65 = w134 * w37; w88 = w88 + w65; w65 = w136 * w35; w88 = w88 + w65;
 w65 = load[15] * w88; w112 = w112 + w65; w65 = load[36] * w122; w66 = load[35] * w103; w65 = w65 - w66;
 w66 = w104 * w70; w42 = w16 * w70; w161 = w89 * w42; w66 = w66 - w161; w161 = w107 * w106; w160 = w16 * w106;
 w38 = w92 * w160; w161 = w161 + w38; w66 = w66 - w161; w65 = w65 + w66; w65 = load[34] * w65; w66 = load[36] * w65;
 w161 = -w70; w161 = R(2.0) * w161; w38 = y[7] * w161; w38 = w38 - w88; w151 = w16 * w122; w38 = w38 - w151;
 w151 = w94 * w160; w158 = w113 * w70; w157 = load[36] * w70; w154 = load[35] * w106; w157 = w157 - w154;
 w154 = w89 * w157; w158 = w158 + w154; w151 = w151 - w158; w38 = w38 + w151; w38 = load[34] * w38; w151 = w16 * w38;
 w66 = w66 - w151; w112 = w112 + w66; w66 = w14 * w112; w73 = w73 + w66; w66 = load[29] * w122; w151 = load[31] * w103;
 w66 = w66 + w151; w151 = load[28] * w70; w158 = load[29] * w106; w151 = w151 + w158; w158 = w94 * w151;
 w154 = w90 * w70; w129 = w89 * w9; w154 = w154 + w129; w158 = w158 - w154; w66 = w66 + w158; w158 = w141 * w13;
 w154 = w134 * w21; w158 = w158 - w154; w154 = w136 * w18; w158 = w158 - w154; w29 = load[15] * w158; w66 = w66 + w29;
 w29 = R(2.0) * w106; w154 = y[7] * w29; w154 = w158 + w154; w129 = w16 * w103; w154 = w154 + w129; w129 = w113 * w106;
 w142 = w92 * w157; w129 = w129 + w142; w142 = w94 * w42; w129 = w129 + w142; w154 = w154 + w129;
 w154 = load[34] * w154; w129 = w16 * w154; w65 = load[35] * w65; w129 = w129 - w65; w66 = w66 + w129; w129 = w13 * w66;
 w65 = w146 * w14; w129 = w129 - w65; w73 = w73 + w129; w73 = lam[0] * w73; w129 = load[6] * w41; w73 = w73 - w129;
 w129 = w16 * w51; w65 = load[31] * w8; w129 = w129 + w65; w65 = load[35] * w101; w129 = w129 - w65;
 w65 = load[29] * w77; w129 = w129 + w65; w65 = w13 * w129; w142 = w140 * w14; w65 = w65 - w142; w142 = w150 * w13;
 w147 = load[29] * w8; w138 = w16 * w83; w147 = w147 + w138; w138 = load[36] * w101; w147 = w147 + w138;
 w138 = load[28] * w77; w147 = w147 + w138; w138 = w14 * w147; w142 = w142 + w138; w65 = w65 + w142; w142 = y[8] * w65;
 w73 = w73 + w142; w142 = w153 * w13; w138 = w26 * w102; w166 = w19 * w9; w167 = w90 * w8; w166 = w166 + w167;
 w138 = w138 - w166; w166 = w94 * w8; w167 = w26 * w106; w166 = w166 - w167; w167 = load[28] * w166; w138 = w138 + w167;
 w167 = w33 * w157; w168 = w113 * w83; w167 = w167 - w168; w138 = w138 - w167; w167 = w24 * w106; w168 = w92 * w51;
 w167 = w167 + w168; w168 = w33 * w70; w169 = w89 * w83; w168 = w168 - w169; w167 = w167 - w168; w168 = load[36] * w167;
 w138 = w138 + w168; w168 = y[7] * w83; w168 = -w168; w168 = R(2.0) * w168; w138 = w138 - w168; w168 = w104 * w101;
 w169 = w40 * w42; w168 = w168 - w169; w138 = w138 + w168; w168 = w40 * w70; w169 = w89 * w101; w168 = w168 + w169;
 w169 = w94 * w51; w168 = w168 - w169; w169 = w16 * w168; w138 = w138 - w169; w169 = w26 * w70; w170 = w94 * w77;
 w169 = w169 - w170; w170 = load[29] * w169; w138 = w138 + w170; w170 = w34 * w106; w171 = w92 * w77;
 w170 = w170 + w171; w171 = w19 * w70; w172 = w89 * w8; w171 = w171 + w172; w170 = w170 - w171; w171 = load[30] * w170;
 w138 = w138 + w171; w171 = y[6] * w129; w138 = w138 - w171; w171 = w14 * w138; w142 = w142 + w171; w157 = w24 * w157;
 w171 = w113 * w51; w157 = w157 + w171; w171 = w26 * w151; w157 = w157 - w171; w171 = y[7] * w51; w171 = R(2.0) * w171;
 w157 = w157 + w171; w171 = load[29] * w166; w157 = w157 + w171; w167 = load[35] * w167; w157 = w157 - w167;
 w167 = w40 * w160; w171 = w107 * w101; w167 = w167 + w171; w157 = w157 - w167; w167 = w94 * w83; w171 = w40 * w106;
 w172 = w92 * w101; w171 = w171 + w172; w167 = w167 + w171; w171 = w16 * w167; w157 = w157 - w171;
 w171 = load[31] * w169; w157 = w157 + w171; w9 = w34 * w9; w171 = w90 * w77; w9 = w9 + w171; w157 = w157 + w9;
 w9 = load[32] * w170; w157 = w157 + w9; w9 = y[6] * w147; w157 = w157 + w9; w9 = w13 * w157; w171 = w159 * w14;
 w9 = w9 - w171; w142 = w142 + w9; w9 = load[32] * w8; w171 = load[36] * w51; w9 = w9 - w171; w171 = load[35] * w83;
 w9 = w9 - w171; w171 = load[30] * w77; w9 = w9 + w171; w171 = load[3] * w9; w172 = w140 * w37; w173 = w21 * w129;
 w172 = w172 + w173; w171 = w171 - w172; w172 = w37 * w147; w173 = w150 * w21; w172 = w172 - w173; w171 = w171 + w172;
 w172 = y[5] * w171; w142 = w142 + w172; w172 = y[4] * w142; w73 = w73 + w172; w73 = load[1] * w73; w109 = w109 + w73;
 w109 = w2 * w109; w52 = w52 * w41; w57 = w57 * w125; w57 = load[0] * w57; w52 = w52 - w57; w75 = load[6] * w125;
 w125 = w37 * w112; w57 = w5 * w21; w125 = w125 - w57; w57 = w146 * w37; w41 = w21 * w66; w57 = w57 + w41;
 w125 = w125 - w57; w57 = load[30] * w122; w41 = load[32] * w103; w57 = w57 + w41; w41 = w98 * w70; w73 = w89 * w102;
 w41 = w41 + w73; w73 = w114 * w106; w172 = w92 * w151; w73 = w73 + w172; w41 = w41 - w73; w57 = w57 + w41;
 w30 = load[13] * w88; w27 = load[14] * w158; w30 = w30 + w27; w57 = w57 - w30; w30 = load[35] * w38;
 w27 = load[36] * w154; w30 = w30 - w27; w57 = w57 + w30; w57 = load[3] * w57; w125 = w125 + w57; w125 = lam[0] * w125;
 w75 = w75 - w125; w125 = w159 * w37; w57 = w21 * w157; w125 = w125 + w57; w151 = w19 * w151; w57 = w114 * w8;
 w151 = w151 + w57; w57 = w104 * w51; w42 = w24 * w42; w57 = w57 - w42; w151 = w151 - w57; w166 = load[30] * w166;
 w151 = w151 + w166; w160 = w33 * w160; w166 = w107 * w83; w160 = w160 - w166; w151 = w151 + w160;
 w160 = load[36] * w167; w151 = w151 + w160; w160 = load[35] * w168; w151 = w151 + w160; w102 = w34 * w102;
 w160 = w98 * w77; w102 = w102 + w160; w151 = w151 - w102; w169 = load[32] * w169; w151 = w151 + w169;
 w170 = load[33] * w170; w151 = w151 + w170; w170 = load[3] * w151; w169 = w37 * w138; w102 = w153 * w21;
 w169 = w169 - w102; w170 = w170 + w169; w125 = w125 - w170; w170 = y[5] * w65; w125 = w125 + w170; w170 = y[4] * w125;
 w75 = w75 + w170; w62 = y[8] * w171; w75 = w75 - w62; w75 = load[1] * w75; w52 = w52 + w75; w52 = w3 * w52;
 w109 = w109 - w52; r4 = w109; w109 = w141 * w50; w52 = w23 * w112; w109 = w109 + w52; w52 = w76 * w138;
 w109 = w109 + w52; w52 = w6 * w66; w75 = w136 * w126; w52 = w52 + w75; w75 = w131 * w129; w52 = w52 + w75;
 w75 = w67 * w157; w52 = w52 + w75; w52 = load[3] * w52; w109 = w109 + w52; w52 = w12 * w66; w75 = w134 * w126;
 w52 = w52 + w75; w75 = w128 * w129; w52 = w52 - w75; w75 = w71 * w157; w52 = w52 + w75; w52 = load[2] * w52;
 w109 = w109 + w52; w52 = w130 * w147; w109 = w109 + w52; w109 = w13 * w109; w52 = w141 * w28; w75 = w5 * w23;
 w52 = w52 + w75; w75 = w76 * w153; w52 = w52 + w75; w75 = w146 * w6; w62 = w136 * w31; w75 = w75 - w62;
 w62 = w131 * w140; w75 = w75 + w62; w62 = w67 * w159; w75 = w75 + w62; w75 = load[3] * w75; w52 = w52 + w75;
 w75 = w146 * w12; w62 = w134 * w31; w75 = w75 - w62; w62 = w128 * w140; w75 = w75 - w62; w62 = w71 * w159;
 w75 = w75 + w62; w75 = load[2] * w75; w52 = w52 + w75; w75 = w130 * w150; w52 = w52 + w75; w52 = w52 * w14;
 w109 = w109 - w52; w146 = w146 * w23; w31 = w141 * w31; w146 = w146 + w31; w31 = w130 * w140; w146 = w146 + w31;
 w31 = w76 * w159; w146 = w146 + w31; w31 = w136 * w28; w52 = w5 * w6; w31 = w31 - w52; w52 = w67 * w153;
 w31 = w31 - w52; w52 = w131 * w150; w31 = w31 - w52; w31 = load[3] * w31; w146 = w146 + w31; w28 = w134 * w28;
 w5 = w5 * w12; w28 = w28 - w5; w5 = w71 * w153; w28 = w28 - w5; w5 = w128 * w150; w28 = w28 + w5; w28 = load[2] * w28;
 w146 = w146 + w28; w146 = w146 * w13; w66 = w23 * w66; w141 = w141 * w126; w66 = w66 - w141; w130 = w130 * w129;
 w66 = w66 + w130; w130 = w76 * w157; w66 = w66 + w130; w136 = w136 * w50; w130 = w6 * w112; w136 = w136 - w130;
 w130 = w67 * w138; w136 = w136 - w130; w131 = w131 * w147; w136 = w136 - w131; w136 = load[3] * w136; w66 = w66 + w136;
 w134 = w134 * w50; w112 = w12 * w112; w134 = w134 - w112; w112 = w71 * w138; w134 = w134 - w112; w128 = w128 * w147;
 w134 = w134 + w128; w134 = load[2] * w134; w66 = w66 + w134; w66 = w14 * w66; w146 = w146 + w66; w109 = w109 - w146;
 r5 = w109; w109 = load[34] * w19; w146 = w14 * w109; w66 = load[34] * w34; w134 = w13 * w66; w146 = w146 - w134;
 w4 = w4 * w146; w134 = w35 * w109; w128 = w18 * w66; w134 = w134 + w128; w134 = load[1] * w134; w4 = w4 + w134;
 w134 = w37 * w109; w128 = w21 * w66; w134 = w134 + w128; w39 = w39 * w134; w4 = w4 - w39; w39 = load[5] * w4;
 w146 = w2 * w146; w134 = w3 * w134; w146 = w146 + w134; w134 = load[4] * w146; w39 = w39 + w134; w45 = w45 * w39;
 w43 = load[4] * w4; w0 = load[5] * w146; w43 = w43 - w0; w46 = w46 * w43; w45 = w45 - w46; r6 = w45; w95 = w19 * w95;
 w44 = w139 * w44; w95 = w95 + w44; w85 = w24 * w85; w44 = w137 * w48; w85 = w85 + w44; w95 = w95 + w85;
 w111 = w34 * w111; w54 = w145 * w54; w111 = w111 + w54; w95 = w95 - w111; w80 = w33 * w80; w111 = w135 * w53;
 w80 = w80 + w111; w95 = w95 - w80; w80 = w155 * w82; w97 = w92 * w97; w80 = w80 + w97; w95 = w95 + w80;
 w80 = w156 * w86; w124 = w89 * w124; w80 = w80 + w124; w95 = w95 - w80; r7 = w95; w154 = w19 * w154; w139 = w139 * w8;
 w154 = w154 + w139; w103 = w24 * w103; w139 = w137 * w51; w103 = w103 + w139; w154 = w154 + w103; w38 = w34 * w38;
 w145 = w145 * w77; w38 = w38 + w145; w154 = w154 - w38; w122 = w33 * w122; w38 = w135 * w83; w122 = w122 - w38;
 w154 = w154 - w122; w122 = w155 * w106; w167 = w92 * w167; w122 = w122 - w167; w154 = w154 + w122; w122 = w156 * w70;
 w168 = w89 * w168; w122 = w122 + w168; w154 = w154 - w122; r8 = w154; w154 = w94 * w89; w154 = w137 + w154;
 w154 = load[34] * w154; w154 = w19 * w154; w137 = w137 * w109; w154 = w154 + w137; w137 = w94 * w92;
 w137 = w137 - w135; w137 = load[34] * w137; w137 = w34 * w137; w154 = w154 - w137; w135 = w135 * w66;
 w154 = w154 + w135; w135 = w94 * w66; w137 = w92 * w135; w154 = w154 - w137; w137 = w94 * w109; w122 = w89 * w137;
 w154 = w154 + w122; r9 = w154; w60 = w12 * w60; w154 = w164 * w47; w60 = w60 - w154; w119 = load[26] * w119;
 w60 = w60 + w119; w119 = load[2] * w117; w60 = w60 + w119; w121 = w35 * w121; w60 = w60 - w121; w115 = w18 * w115;
 w60 = w60 + w115; w96 = load[27] * w96; w60 = w60 + w96; w68 = w23 * w68; w96 = w133 * w36; w68 = w68 + w96;
 w60 = w60 + w68; w123 = load[24] * w123; w60 = w60 + w123; w60 = load[0] * w60; w61 = w11 * w61; w63 = w63 * w22;
 w61 = w61 - w63; w60 = w60 + w61; w152 = w152 * w11; w120 = w22 * w120; w152 = w152 + w120; w60 = w60 + w152;
 r10 = w60; w60 = load[2] * w151; w138 = w35 * w138; w152 = w153 * w18; w138 = w138 - w152; w60 = w60 - w138;
 w138 = w159 * w35; w157 = w18 * w157; w138 = w138 + w157; w60 = w60 + w138; w60 = load[0] * w60; w125 = w11 * w125;
 w60 = w60 + w125; w142 = w22 * w142; w60 = w60 + w142; r11 = w60; w60 = w33 * w92; w142 = w107 * w66; w60 = w60 - w142;
 w142 = w104 * w109; w125 = w24 * w89; w142 = w142 - w125; w60 = w60 - w142; w142 = load[36] * w135; w60 = w60 + w142;
 w142 = load[35] * w137; w60 = w60 - w142; w142 = load[2] * w60; w125 = w113 * w66; w138 = w92 * w109; w157 = w89 * w66;
 w138 = w138 + w157; w157 = load[36] * w138; w125 = w125 + w157; w157 = y[7] * w66; w157 = -w157; w157 = R(2.0) * w157;
 w125 = w125 - w157; w157 = w40 * w89; w125 = w125 - w157; w137 = w16 * w137; w137 = w156 - w137; w125 = w125 - w137;
 w137 = w16 * w109; w137 = w24 + w137; w157 = y[6] * w137; w125 = w125 - w157; w157 = w35 * w125; w142 = w142 - w157;
 w157 = w113 * w109; w152 = y[7] * w109; w152 = R(2.0) * w152; w157 = w157 + w152; w138 = load[35] * w138;
 w157 = w157 - w138; w138 = w40 * w92; w157 = w157 - w138; w135 = w16 * w135; w135 = w155 - w135; w157 = w157 + w135;
 w135 = w16 * w66; w135 = w33 - w135; w138 = y[6] * w135; w157 = w157 - w138; w138 = w18 * w157; w142 = w142 + w138;
 w142 = load[0] * w142; w138 = w21 * w157; w152 = load[3] * w60; w120 = w37 * w125; w152 = w152 + w120;
 w138 = w138 - w152; w152 = w13 * w137; w120 = w14 * w135; w152 = w152 - w120; w120 = y[5] * w152; w138 = w138 + w120;
 w138 = w11 * w138; w142 = w142 + w138; w125 = w14 * w125; w157 = w13 * w157; w125 = w125 + w157;
 w157 = load[36] * w109; w138 = load[35] * w66; w157 = w157 + w138; w138 = load[3] * w157; w120 = w21 * w137;
 w138 = w138 + w120; w120 = w37 * w135; w138 = w138 + w120; w58 = y[5] * w138; w125 = w125 - w58; w125 = w22 * w125;
 w142 = w142 + w125; r12 = w142; w142 = load[25] * w22; w125 = load[23] * w11; w142 = w142 - w125;
 w125 = load[26] * load[0]; w142 = w142 + w125; w125 = w12 * w142; w58 = w12 * load[0]; w120 = w6 * w11;
 w58 = w58 - w120; w120 = load[26] * w58; w125 = w125 + w120; w120 = w14 * w22; w61 = w37 * w11; w120 = w120 - w61;
 w61 = w35 * load[0]; w120 = w120 - w61; w61 = load[28] * w120; w63 = w21 * w11; w123 = w13 * w22; w63 = w63 + w123;
 w123 = w18 * load[0]; w63 = w63 + w123; w123 = load[29] * w63; w61 = w61 + w123; w123 = load[2] * load[0];
 w68 = load[3] * w11; w123 = w123 - w68; w68 = load[30] * w123; w61 = w61 + w68; w68 = w19 * w61; w96 = load[35] * w123;
 w115 = w16 * w120; w96 = w96 - w115; w115 = w24 * w96; w68 = w68 - w115; w115 = w19 * w123; w121 = w26 * w63;
 w115 = w115 - w121; w121 = load[30] * w115; w68 = w68 + w121; w121 = w16 * w63; w119 = load[36] * w123;
 w121 = w121 - w119; w119 = w33 * w121; w68 = w68 + w119; w119 = w33 * w123; w154 = w40 * w63; w119 = w119 - w154;
 w154 = load[36] * w119; w68 = w68 - w154; w154 = w40 * w120; w122 = w24 * w123; w154 = w154 - w122;
 w122 = load[35] * w154; w68 = w68 + w122; w122 = load[29] * w120; w168 = load[31] * w63; w122 = w122 + w168;
 w168 = load[32] * w123; w122 = w122 + w168; w168 = w34 * w122; w68 = w68 - w168; w168 = w26 * w120; w167 = w34 * w123;
 w168 = w168 - w167; w167 = load[32] * w168; w68 = w68 + w167; w167 = w34 * w63; w38 = w19 * w120; w167 = w167 - w38;
 w38 = load[33] * w167; w68 = w68 + w38; w38 = load[2] * w68; w125 = w125 + w38; w122 = w26 * w122;
 w38 = load[30] * w120; w145 = load[32] * w63; w38 = w38 + w145; w123 = load[33] * w123; w38 = w38 + w123;
 w123 = w19 * w38; w122 = w122 - w123; w123 = load[28] * w115; w122 = w122 + w123; w123 = load[36] * w120;
 w145 = load[35] * w63; w123 = w123 - w145; w145 = w33 * w123; w122 = w122 - w145; w145 = w24 * w63; w77 = w33 * w120;
 w145 = w145 - w77; w77 = load[36] * w145; w122 = w122 + w77; w96 = w40 * w96; w122 = w122 + w96; w154 = w16 * w154;
 w122 = w122 - w154; w154 = load[29] * w168; w122 = w122 + w154; w154 = load[30] * w167; w122 = w122 + w154;
 w154 = w35 * w122; w125 = w125 - w154; w123 = w24 * w123; w61 = w26 * w61; w123 = w123 - w61; w115 = load[29] * w115;
 w123 = w123 + w115; w145 = load[35] * w145; w123 = w123 - w145; w121 = w40 * w121; w123 = w123 - w121;
 w119 = w16 * w119; w123 = w123 + w119; w168 = load[31] * w168; w123 = w123 + w168; w38 = w34 * w38; w123 = w123 + w38;
 w167 = load[32] * w167; w123 = w123 + w167; w167 = w18 * w123; w125 = w125 + w167; w167 = w23 * w11; w38 = w12 * w22;
 w167 = w167 - w38; w38 = load[27] * w167; w125 = w125 + w38; w38 = load[23] * w22; w168 = load[22] * w11;
 w38 = w38 - w168; w168 = load[24] * load[0]; w38 = w38 + w168; w168 = w23 * w38; w125 = w125 + w168;
 w168 = w23 * load[0]; w119 = w6 * w22; w168 = w168 - w119; w119 = load[24] * w168; w125 = w125 + w119;
 w125 = load[0] * w125; w119 = w21 * w123; w142 = w6 * w142; w121 = load[23] * w58; w142 = w142 + w121;
 w121 = load[3] * w68; w142 = w142 + w121; w121 = w37 * w122; w142 = w142 + w121; w119 = w119 - w142;
 w142 = load[26] * w22; w121 = load[24] * w11; w142 = w142 - w121; w121 = load[27] * load[0]; w142 = w142 + w121;
 w121 = w23 * w142; w119 = w119 + w121; w121 = load[24] * w167; w119 = w119 - w121; w121 = load[22] * w168;
 w119 = w119 - w121; w119 = w11 * w119; w125 = w125 + w119; w58 = load[25] * w58; w38 = w6 * w38; w58 = w58 - w38;
 w142 = w12 * w142; w58 = w58 - w142; w122 = w14 * w122; w58 = w58 + w122; w123 = w13 * w123; w58 = w58 + w123;
 w167 = load[26] * w167; w58 = w58 + w167; w55 = load[23] * w168; w58 = w58 + w55; w58 = w22 * w58; w125 = w125 + w58;
 r13 = w125; w125 = load[25] * w71; w132 = w132 + w125; w125 = w67 * load[24]; w133 = w133 + w125;
 w125 = w71 * load[27]; w133 = w133 + w125; w132 = w132 + w133; w133 = w37 * w76; w125 = w14 * w71; w133 = w133 + w125;
 w125 = y[6] * w18; w133 = w133 + w125; w125 = load[28] * w133; w58 = w13 * w71; w55 = w21 * w76; w58 = w58 - w55;
 w81 = y[6] * w35; w58 = w58 + w81; w81 = load[29] * w58; w125 = w125 + w81; w81 = load[3] * w76; w55 = load[30] * w81;
 w125 = w125 + w55; w55 = w90 * w18; w168 = load[32] * w18; w167 = load[30] * w35; w168 = w168 - w167;
 w167 = load[33] * load[2]; w168 = w168 + w167; w167 = w92 * w168; w55 = w55 + w167; w167 = w98 * load[2];
 w123 = load[31] * w18; w122 = load[29] * w35; w123 = w123 - w122; w122 = load[32] * load[2]; w123 = w123 + w122;
 w122 = w94 * w123; w167 = w167 + w122; w55 = w55 - w167; w125 = w125 + w55; w55 = load[36] * w133;
 w167 = load[35] * w58; w55 = w55 - w167; w167 = load[35] * load[2]; w122 = w16 * w35; w167 = w167 + w122;
 w122 = w89 * w167; w142 = w104 * w35; w122 = w122 - w142; w142 = w107 * w18; w38 = w16 * w18;
 w119 = load[36] * load[2]; w38 = w38 - w119; w119 = w92 * w38; w142 = w142 + w119; w122 = w122 - w142;
 w55 = w55 + w122; w55 = load[34] * w55; w122 = load[36] * w55; w142 = R(2.0) * w35; w119 = y[7] * w142;
 w121 = load[35] * w81; w145 = w16 * w133; w121 = w121 - w145; w119 = w119 + w121; w107 = w107 * load[2];
 w121 = w94 * w38; w107 = w107 + w121; w121 = w113 * w35; w145 = load[36] * w35; w115 = load[35] * w18;
 w145 = w145 + w115; w115 = w89 * w145; w121 = w121 + w115; w107 = w107 + w121; w119 = w119 + w107;
 w119 = load[34] * w119; w107 = w16 * w119; w122 = w122 - w107; w125 = w125 + w122; w122 = w14 * w125;
 w107 = load[29] * w133; w121 = load[31] * w58; w107 = w107 + w121; w121 = load[32] * w81; w107 = w107 + w121;
 w121 = w114 * load[2]; w115 = load[29] * w18; w61 = load[28] * w35; w115 = w115 - w61; w61 = load[30] * load[2];
 w115 = w115 + w61; w61 = w94 * w115; w121 = w121 + w61; w61 = w89 * w168; w90 = w90 * w35; w61 = w61 - w90;
 w121 = w121 - w61; w107 = w107 + w121; w121 = R(2.0) * w18; w108 = y[7] * w121; w61 = w16 * w58; w90 = load[36] * w81;
 w61 = w61 - w90; w108 = w108 + w61; w113 = w113 * w18; w61 = w92 * w145; w113 = w113 - w61; w104 = w104 * load[2];
 w94 = w94 * w167; w104 = w104 + w94; w113 = w113 - w104; w108 = w108 + w113; w15 = load[34] * w108; w108 = w16 * w15;
 w55 = load[35] * w55; w108 = w108 - w55; w107 = w107 + w108; w108 = w13 * w107; w122 = w122 + w108; w132 = w132 + w122;
 w132 = lam[0] * w132; w64 = load[25] * w12; w122 = w6 * load[24]; w64 = w64 - w122; w122 = w12 * load[27];
 w64 = w64 - w122; w122 = w26 * w123; w108 = w19 * w168; w122 = w122 - w108; w108 = w19 * load[2]; w55 = w26 * w18;
 w108 = w108 - w55; w79 = load[28] * w108; w122 = w122 + w79; w79 = w33 * w145; w122 = w122 + w79; w79 = w24 * w18;
 w55 = w33 * w35; w79 = w79 + w55; w55 = load[36] * w79; w122 = w122 + w55; w55 = w40 * w167; w122 = w122 + w55;
 w55 = w40 * w35; w113 = w24 * load[2]; w55 = w55 + w113; w113 = w16 * w55; w122 = w122 + w113; w113 = w26 * w35;
 w104 = w34 * load[2]; w113 = w113 + w104; w104 = load[29] * w113; w122 = w122 - w104; w104 = w34 * w18;
 w94 = w19 * w35; w104 = w104 + w94; w94 = load[30] * w104; w122 = w122 + w94; w94 = w14 * w122; w64 = w64 + w94;
 w84 = load[29] * w108; w145 = w24 * w145; w26 = w26 * w115; w145 = w145 + w26; w84 = w84 - w145; w79 = load[35] * w79;
 w84 = w84 - w79; w79 = w40 * w38; w84 = w84 - w79; w79 = w33 * load[2]; w40 = w40 * w18; w79 = w79 - w40;
 w16 = w16 * w79; w84 = w84 + w16; w99 = load[31] * w113; w84 = w84 - w99; w168 = w34 * w168; w84 = w84 + w168;
 w168 = load[32] * w104; w84 = w84 + w168; w168 = w13 * w84; w64 = w64 + w168; w64 = w64 + w163; w64 = w64 + w162;
 w163 = y[4] * w64; w132 = w132 + w163; w132 = load[1] * w132; w2 = w2 * w132; w132 = w21 * w84; w163 = w6 * load[26];
 w163 = w163 + w149; w149 = w19 * w115; w167 = w24 * w167; w149 = w149 - w167; w108 = load[30] * w108;
 w149 = w149 + w108; w38 = w33 * w38; w149 = w149 + w38; w38 = load[36] * w79; w149 = w149 - w38; w38 = load[35] * w55;
 w149 = w149 - w38; w38 = w34 * w123; w149 = w149 - w38; w113 = load[32] * w113; w149 = w149 - w113;
 w104 = load[33] * w104; w149 = w149 + w104; w104 = load[3] * w149; w163 = w163 + w104; w104 = w37 * w122;
 w163 = w163 + w104; w132 = w132 - w163; w163 = w23 * load[27]; w132 = w132 + w163; w163 = load[22] * w23;
 w132 = w132 - w163; w132 = w132 + w143; w59 = y[4] * w132; w69 = load[22] * w76; w69 = w69 + w165;
 w78 = w76 * load[27]; w165 = w67 * load[26]; w164 = w164 + w165; w78 = w78 - w164; w69 = w69 + w78; w37 = w37 * w125;
 w21 = w21 * w107; w37 = w37 - w21; w21 = load[30] * w133; w78 = load[32] * w58; w21 = w21 + w78; w93 = load[33] * w81;
 w21 = w21 + w93; w123 = w89 * w123; w98 = w98 * w35; w123 = w123 - w98; w114 = w114 * w18; w115 = w92 * w115;
 w114 = w114 + w115; w123 = w123 - w114; w21 = w21 + w123; w123 = load[35] * w119; w114 = load[36] * w15;
 w123 = w123 - w114; w21 = w21 + w123; w21 = load[3] * w21; w37 = w37 + w21; w69 = w69 + w37; w7 = lam[0] * w69;
 w59 = w59 - w7; w10 = load[1] * w59; w3 = w3 * w10; w2 = w2 - w3; r14 = w2; w2 = w23 * w125; w3 = w76 * w122;
 w2 = w2 + w3; w3 = w6 * w107; w10 = w67 * w84; w159 = w159 + w10; w3 = w3 + w159; w3 = load[3] * w3; w2 = w2 + w3;
 w3 = w12 * w107; w159 = w140 * w76; w3 = w3 - w159; w159 = w71 * w84; w3 = w3 + w159; w3 = load[2] * w3; w2 = w2 + w3;
 w3 = w150 * w71; w2 = w2 + w3; w13 = w13 * w2; w107 = w23 * w107; w2 = w140 * w71; w107 = w107 + w2; w2 = w76 * w84;
 w107 = w107 + w2; w6 = w6 * w125; w67 = w67 * w122; w153 = w153 + w67; w6 = w6 + w153; w17 = load[3] * w6;
 w107 = w107 - w17; w76 = w150 * w76; w125 = w12 * w125; w71 = w71 * w122; w125 = w125 + w71; w76 = w76 - w125;
 w76 = load[2] * w76; w107 = w107 + w76; w14 = w14 * w107; w13 = w13 - w14; r15 = w13; w15 = w19 * w15; w58 = w24 * w58;
 w15 = w15 + w58; w119 = w34 * w119; w15 = w15 - w119; w133 = w33 * w133; w15 = w15 - w133; w155 = w155 * w18;
 w79 = w92 * w79; w155 = w155 + w79; w15 = w15 + w155; w156 = w156 * w35; w55 = w89 * w55; w156 = w156 + w55;
 w15 = w15 + w156; r16 = w15; w12 = w12 * load[26]; w12 = R(2.0) * w12; w15 = load[2] * w149; w12 = w12 + w15;
 w122 = w35 * w122; w12 = w12 - w122; w84 = w18 * w84; w12 = w12 + w84; w84 = w23 * load[24]; w12 = w12 + w84;
 w23 = load[24] * w23; w12 = w12 + w23; w23 = load[0] * w12; w132 = w11 * w132; w23 = w23 + w132; w64 = w22 * w64;
 w23 = w23 + w64; r17 = w23; r18 = w12; w86 = w140 * w86; w12 = w89 * w118; w86 = w86 + w12; w117 = w117 - w86;
 w82 = w150 * w82; w86 = w92 * w100; w82 = w82 + w86; w117 = w117 + w82; r19 = w117; w70 = w140 * w70;
 w117 = w89 * w129; w70 = w70 + w117; w151 = w151 - w70; w106 = w150 * w106; w70 = w92 * w147; w106 = w106 + w70;
 w151 = w151 + w106; r20 = w151; w89 = w89 * w137; w60 = w60 - w89; w92 = w92 * w135; w60 = w60 - w92; r21 = w60;
 w60 = w140 * w120; w68 = w68 - w60; w60 = w150 * w63; w68 = w68 + w60; r22 = w68; w140 = w140 * w35;
 w149 = w149 + w140; w150 = w150 * w18; w149 = w149 + w150; r23 = w149; w149 = w19 * load[30]; w68 = w24 * load[35];
 w149 = w149 - w68; w87 = load[30] * w19; w149 = w149 + w87; w87 = w33 * load[36]; w149 = w149 - w87;
 w25 = load[36] * w33; w149 = w149 - w25; w32 = load[35] * w24; w149 = w149 - w32; w32 = w34 * load[32];
 w149 = w149 - w32; w91 = load[32] * w34; w149 = w149 - w91; r24 = w149; w116 = w24 * w116; w48 = w148 * w48;
 w116 = w116 + w48; w110 = w33 * w110; w53 = w144 * w53; w110 = w110 + w53; w116 = w116 + w110; r25 = w116;
 w29 = w24 * w29; w51 = w148 * w51; w29 = w29 + w51; w161 = w33 * w161; w83 = w144 * w83; w161 = w161 - w83;
 w29 = w29 + w161; r26 = w29; w148 = w148 * w109; w144 = w144 * w66; w148 = w148 - w144; r27 = w148; w63 = R(2.0) * w63;
 w63 = w24 * w63; w120 = -w120; w120 = R(2.0) * w120; w120 = w33 * w120; w63 = w63 + w120; r28 = w63; w24 = w24 * w121;
 w33 = w33 * w142; w24 = w24 + w33; r29 = w24; w74 = load[24] * w47; w47 = load[2] * w49; w74 = w74 + w47;
 w118 = w18 * w118; w74 = w74 + w118; w100 = w35 * w100; w74 = w74 - w100; w72 = load[26] * w36; w74 = w74 + w72;
 w72 = load[0] * w74; w143 = w143 * w11; w105 = w22 * w105; w143 = w143 + w105; w72 = w72 + w143; w127 = w11 * w127;
 w162 = w162 * w22; w127 = w127 - w162; w72 = w72 - w127; r30 = w72; w72 = load[2] * w9; w129 = w18 * w129;
 w140 = w140 + w129; w72 = w72 + w140; w147 = w35 * w147; w147 = w147 - w150; w72 = w72 - w147; w147 = load[0] * w72;
 w65 = w22 * w65; w147 = w147 + w65; w171 = w11 * w171; w147 = w147 - w171; r31 = w147; w18 = w18 * w137;
 w20 = load[2] * w157; w18 = w18 - w20; w35 = w35 * w135; w18 = w18 + w35; w1 = load[0] * w18; w22 = w22 * w152;
 w1 = w1 + w22; w11 = w11 * w138; w1 = w1 + w11; r32 = w1; r33 = w74; r34 = w72; r35 = w18; r36 = w49; r37 = w9;
 w157 = -w157; r38 = w157; r39 = w56; r40 = w101; bend[0] += r0; bend[1] += r1; bend[13] += r2; bend[2] += r3;
 bend[14] += r4; bend[26] += r5; bend[3] += r6; bend[15] += r7; bend[27] += r8; bend[39] += r9; bend[16] += r10;
 bend[28] += r11; bend[40] += r12; bend[52] += r13; bend[17] += r14; bend[29] += r15; bend[41] += r16; bend[53] += r17;
 bend[65] += r18; bend[18] += r19; bend[30] += r20; bend[42] += r21; bend[54] += r22; bend[66] += r23; bend[78] += r24;
 bend[19] += r25; bend[31] += r26; bend[43] += r27; bend[55] += r28; bend[67] += r29; bend[20] += r30; bend[32] += r31;
 bend[44] += r32; bend[21] += r33; bend[33] += r34; bend[45] += r35; bend[22] += r36; bend[34] += r37; bend[46] += r38;
 bend[23] += r39; bend[35] += r40;
}

static void worm_coulomb_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w5, w6, w7, w8, w9, w10, w11, w12; real r0, r1, r2; w2 = drive[8] * drive[3]; w3 = drive[2] + w2;
 w3 = w3 * drive[1]; w6 = drive[2] * w2; w7 = R(1.0) - w6; w3 = w3 / w7; w8 = drive[5] * v[2]; w7 = v[0] + w8;
 w8 = drive[13] * sigma[0]; w7 = w7 + w8; w8 = drive[14] * v[1]; w7 = w7 + w8; w3 = w3 * w7; w9 = drive[0] * v[2];
 w8 = drive[4] * w9; w3 = w3 + w8; w9 = drive[11] * sigma[0]; w3 = w3 + w9; w11 = drive[0] * v[1];
 w12 = drive[12] * w11; w3 = w3 + w12; w3 = sigma[0] * w3; w10 = w3 / drive[15]; r0 = w10; w1 = drive[2] - w2;
 w1 = w1 * drive[1]; w5 = R(1.0) + w6; w1 = w1 / w5; w1 = w1 * w7; w1 = w1 + w8; w1 = w1 + w9; w1 = w1 + w12;
 w0 = sigma[0] * w1; w1 = w0 / drive[15]; r1 = w1; w1 = w3 + w0; w11 = R(2.0) * drive[15]; w1 = w1 / w11; w3 = w3 - w0;
 w3 = w3 / w11; w3 = w3 * w3; w3 = w3 + R(1e-06); w3 = V(sqrt)(w3); w1 = w1 + w3; w1 = w1 - R(0.001); w1 = -w1; r2 = w1;
 g[0] = r0; g[1] = r1; g[2] = r2;
}

static void worm_coulomb_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w5, w6, w7, w9, w10, w11, w12, w13; real w14, w15, w16, w17, w18, r0, r1, r2, r3, r4, r5, r6;
 real r7, r8, r9, r10, r11; w2 = drive[8] * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w6 = drive[2] * w2;
 w7 = R(1.0) - w6; w3 = w3 / w7; w10 = drive[5] * v[2]; w7 = v[0] + w10; w10 = drive[13] * sigma[0]; w7 = w7 + w10;
 w12 = drive[14] * v[1]; w7 = w7 + w12; w12 = w3 * w7; w9 = drive[0] * v[2]; w9 = drive[4] * w9; w12 = w12 + w9;
 w15 = drive[11] * sigma[0]; w12 = w12 + w15; w11 = drive[0] * v[1]; w11 = drive[12] * w11; w12 = w12 + w11;
 w12 = sigma[0] * w12; w18 = w12 / drive[15]; r0 = w18; w1 = drive[2] - w2; w1 = w1 * drive[1]; w5 = R(1.0) + w6;
 w1 = w1 / w5; w7 = w1 * w7; w7 = w7 + w9; w7 = w7 + w15; w7 = w7 + w11; w7 = sigma[0] * w7; w11 = w7 / drive[15];
 r1 = w11; w11 = w12 + w7; w15 = R(2.0) * drive[15]; w11 = w11 / w15; w12 = w12 - w7; w12 = w12 / w15; w7 = w12 * w12;
 w7 = w7 + R(1e-06); w7 = V(sqrt)(w7); w11 = w11 + w7; w11 = w11 - R(0.001); w11 = -w11; r2 = w11; w11 = sigma[0] * w3;
 w9 = w11 / drive[15]; r3 = w9; w9 = sigma[0] * w1; w5 = w9 / drive[15]; r4 = w5; w5 = w11 + w9; w5 = w5 / w15;
 w12 = R(2.0) * w12; w11 = w11 - w9; w11 = w11 / w15; w11 = w12 * w11; w7 = R(2.0) * w7; w11 = w11 / w7; w5 = w5 + w11;
 w5 = -w5; r5 = w5; w5 = w3 * drive[14]; w16 = drive[12] * drive[0]; w5 = w5 + w16; w5 = sigma[0] * w5;
 w11 = w5 / drive[15]; r6 = w11; w10 = w1 * drive[14]; w10 = w10 + w16; w10 = sigma[0] * w10; w16 = w10 / drive[15];
 r7 = w16; w16 = w5 + w10; w16 = w16 / w15; w5 = w5 - w10; w5 = w5 / w15; w5 = w12 * w5; w5 = w5 / w7; w16 = w16 + w5;
 w16 = -w16; r8 = w16; w3 = w3 * drive[5]; w13 = drive[4] * drive[0]; w3 = w3 + w13; w3 = sigma[0] * w3;
 w14 = w3 / drive[15]; r9 = w14; w1 = w1 * drive[5]; w1 = w1 + w13; w0 = sigma[0] * w1; w17 = w0 / drive[15]; r10 = w17;
 w17 = w3 + w0; w17 = w17 / w15; w3 = w3 - w0; w3 = w3 / w15; w12 = w12 * w3; w12 = w12 / w7; w17 = w17 + w12;
 w17 = -w17; r11 = w17; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[3] = r4; by[6] = r5; by[1] = r6; by[4] = r7;
 by[7] = r8; by[2] = r9; by[5] = r10; by[8] = r11;
}

static void worm_coulomb_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, w13, w14, r0, r1, r2, r3, r4, r5;
 w1 = drive[8] * drive[3]; w2 = drive[2] - w1; w2 = w2 * drive[1]; w5 = drive[2] * w1; w6 = R(1.0) + w5; w2 = w2 / w6;
 w0 = drive[2] + w1; w0 = w0 * drive[1]; w4 = R(1.0) - w5; w0 = w0 / w4; w1 = drive[5] * v[2]; w4 = v[0] + w1;
 w1 = drive[13] * sigma[0]; w4 = w4 + w1; w9 = drive[14] * v[1]; w4 = w4 + w9; w9 = w0 * w4; w3 = drive[0] * v[2];
 w3 = drive[4] * w3; w9 = w9 + w3; w12 = drive[11] * sigma[0]; w9 = w9 + w12; w8 = drive[0] * v[1]; w8 = drive[12] * w8;
 w9 = w9 + w8; w9 = sigma[0] * w9; w4 = w2 * w4; w4 = w4 + w3; w4 = w4 + w12; w4 = w4 + w8; w4 = sigma[0] * w4;
 w9 = w9 - w4; w4 = R(2.0) * drive[15]; w9 = w9 / w4; w8 = w9 * w9; w8 = w8 + R(1e-06); w8 = V(sqrt)(w8);
 w8 = R(2.0) * w8; w7 = lam[2] / w8; w12 = sigma[0] * w0; w3 = sigma[0] * w2; w12 = w12 - w3; w12 = w12 / w4;
 w3 = R(2.0) * w12; w3 = w7 * w3; w9 = R(2.0) * w9; w14 = w7 / w8; w12 = w9 * w12; w12 = w12 / w8; w12 = R(2.0) * w12;
 w12 = w14 * w12; w12 = w9 * w12; w3 = w3 - w12; w3 = w3 / w4; w3 = sigma[0] * w3; w12 = w2 * w3; w3 = w0 * w3;
 w12 = w12 - w3; r0 = w12; w12 = w0 * drive[14]; w13 = drive[12] * drive[0]; w12 = w12 + w13; w12 = sigma[0] * w12;
 w3 = w2 * drive[14]; w3 = w3 + w13; w3 = sigma[0] * w3; w12 = w12 - w3; w12 = w12 / w4; w3 = R(2.0) * w12;
 w3 = w7 * w3; w12 = w9 * w12; w12 = w12 / w8; w12 = R(2.0) * w12; w12 = w14 * w12; w12 = w9 * w12; w3 = w3 - w12;
 w3 = w3 / w4; w3 = sigma[0] * w3; w12 = w2 * w3; w3 = w0 * w3; w12 = w12 - w3; r1 = w12; w12 = drive[14] * w12;
 r2 = w12; w12 = w0 * drive[5]; w10 = drive[4] * drive[0]; w12 = w12 + w10; w12 = sigma[0] * w12; w11 = w2 * drive[5];
 w11 = w11 + w10; w11 = sigma[0] * w11; w12 = w12 - w11; w12 = w12 / w4; w11 = R(2.0) * w12; w7 = w7 * w11;
 w12 = w9 * w12; w12 = w12 / w8; w12 = R(2.0) * w12; w14 = w14 * w12; w9 = w9 * w14; w7 = w7 - w9; w7 = w7 / w4;
 w6 = sigma[0] * w7; w2 = w2 * w6; w0 = w0 * w6; w2 = w2 - w0; r3 = w2; w1 = drive[14] * w2; r4 = w1;
 w5 = drive[5] * w2; r5 = w5; bend[0] += r0; bend[1] += r1; bend[4] += r2; bend[2] += r3; bend[5] += r4; bend[8] += r5;
}

static void worm_coulomb_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w5, w6, w7, w8, w9, w11, w12, r0; w2 = drive[8] * drive[3]; w3 = drive[2] + w2;
 w3 = w3 * drive[1]; w6 = drive[2] * w2; w7 = R(1.0) - w6; w3 = w3 / w7; w8 = drive[5] * v[2]; w7 = v[0] + w8;
 w8 = drive[13] * sigma[0]; w7 = w7 + w8; w8 = drive[14] * v[1]; w7 = w7 + w8; w3 = w3 * w7; w9 = drive[0] * v[2];
 w8 = drive[4] * w9; w3 = w3 + w8; w9 = drive[11] * sigma[0]; w3 = w3 + w9; w11 = drive[0] * v[1];
 w12 = drive[12] * w11; w3 = w3 + w12; w3 = sigma[0] * w3; w3 = w3 / drive[16]; w1 = drive[2] - w2; w1 = w1 * drive[1];
 w5 = R(1.0) + w6; w1 = w1 / w5; w1 = w1 * w7; w1 = w1 + w8; w1 = w1 + w9; w1 = w1 + w12; w0 = sigma[0] * w1;
 w0 = w0 / drive[16]; w11 = w3 + w0; w11 = w11 / R(2.0); w3 = w3 - w0; w3 = w3 * w3; w3 = w3 / R(4.0);
 w3 = w3 + R(0.0001); w3 = V(sqrt)(w3); w11 = w11 + w3; r0 = w11; g[0] = r0;
}

static void worm_coulomb_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w5, w6, w7, w8, w9, w10, w11, w12; real w13, w14, w15, w16, r0, r1, r2, r3;
 w2 = drive[8] * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w6 = drive[2] * w2; w7 = R(1.0) - w6; w3 = w3 / w7;
 w10 = drive[5] * v[2]; w7 = v[0] + w10; w10 = drive[13] * sigma[0]; w7 = w7 + w10; w12 = drive[14] * v[1];
 w7 = w7 + w12; w12 = w3 * w7; w9 = drive[0] * v[2]; w9 = drive[4] * w9; w12 = w12 + w9; w15 = drive[11] * sigma[0];
 w12 = w12 + w15; w11 = drive[0] * v[1]; w11 = drive[12] * w11; w12 = w12 + w11; w12 = sigma[0] * w12;
 w12 = w12 / drive[16]; w1 = drive[2] - w2; w1 = w1 * drive[1]; w5 = R(1.0) + w6; w1 = w1 / w5; w7 = w1 * w7;
 w7 = w7 + w9; w7 = w7 + w15; w7 = w7 + w11; w7 = sigma[0] * w7; w7 = w7 / drive[16]; w11 = w12 + w7;
 w11 = w11 / R(2.0); w12 = w12 - w7; w7 = w12 * w12; w7 = w7 / R(4.0); w7 = w7 + R(0.0001); w7 = V(sqrt)(w7);
 w11 = w11 + w7; r0 = w11; w12 = R(2.0) * w12; w7 = R(2.0) * w7; w15 = R(0.25) / w7; w12 = w12 * w15;
 w15 = R(0.5) - w12; w15 = w15 / drive[16]; w15 = sigma[0] * w15; w1 = w1 * w15; w12 = w12 + R(0.5);
 w12 = w12 / drive[16]; w0 = sigma[0] * w12; w3 = w3 * w0; w1 = w1 + w3; r1 = w1; w15 = w15 + w0; w16 = drive[12] * w15;
 w16 = drive[0] * w16; w10 = drive[14] * w1; w16 = w16 + w10; r2 = w16; w13 = drive[4] * w15; w14 = drive[0] * w13;
 w8 = drive[5] * w1; w14 = w14 + w8; r3 = w14; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void worm_coulomb_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w4, w5, w6, w7, w8, w9, w10, w11, w12; real w13, w14, w15, w16, w17, w18, r0, r1, r2, r3, r4, r5;
 w1 = drive[8] * drive[3]; w2 = drive[2] + w1; w2 = w2 * drive[1]; w5 = drive[2] * w1; w6 = R(1.0) - w5; w2 = w2 / w6;
 w12 = drive[5] * v[2]; w9 = v[0] + w12; w12 = drive[13] * sigma[0]; w9 = w9 + w12; w14 = drive[14] * v[1];
 w9 = w9 + w14; w14 = w2 * w9; w11 = drive[0] * v[2]; w11 = drive[4] * w11; w14 = w14 + w11; w17 = drive[11] * sigma[0];
 w14 = w14 + w17; w13 = drive[0] * v[1]; w13 = drive[12] * w13; w14 = w14 + w13; w14 = sigma[0] * w14;
 w14 = w14 / drive[16]; w0 = drive[2] - w1; w0 = w0 * drive[1]; w4 = R(1.0) + w5; w0 = w0 / w4; w9 = w0 * w9;
 w9 = w9 + w11; w9 = w9 + w17; w9 = w9 + w13; w9 = sigma[0] * w9; w9 = w9 / drive[16]; w14 = w14 - w9; w9 = w14 * w14;
 w9 = w9 / R(4.0); w9 = w9 + R(0.0001); w9 = V(sqrt)(w9); w9 = R(2.0) * w9; w8 = lam[0] / w9; w13 = R(0.25) * w8;
 w17 = sigma[0] * w2; w17 = w17 / drive[16]; w11 = sigma[0] * w0; w11 = w11 / drive[16]; w17 = w17 - w11;
 w11 = R(2.0) * w17; w11 = w13 * w11; w14 = R(2.0) * w14; w8 = w8 / w9; w17 = w14 * w17; w17 = R(0.25) * w17;
 w17 = w17 / w9; w17 = R(2.0) * w17; w17 = w8 * w17; w17 = R(0.25) * w17; w17 = w14 * w17; w11 = w11 - w17;
 w11 = w11 / drive[16]; w11 = sigma[0] * w11; w17 = w2 * w11; w11 = w0 * w11; w17 = w17 - w11; r0 = w17;
 w17 = w2 * drive[14]; w18 = drive[12] * drive[0]; w17 = w17 + w18; w17 = sigma[0] * w17; w17 = w17 / drive[16];
 w11 = w0 * drive[14]; w11 = w11 + w18; w11 = sigma[0] * w11; w11 = w11 / drive[16]; w17 = w17 - w11;
 w11 = R(2.0) * w17; w11 = w13 * w11; w17 = w14 * w17; w17 = R(0.25) * w17; w17 = w17 / w9; w17 = R(2.0) * w17;
 w17 = w8 * w17; w17 = R(0.25) * w17; w17 = w14 * w17; w11 = w11 - w17; w11 = w11 / drive[16]; w11 = sigma[0] * w11;
 w17 = w2 * w11; w11 = w0 * w11; w17 = w17 - w11; r1 = w17; w17 = drive[14] * w17; r2 = w17; w17 = w2 * drive[5];
 w15 = drive[4] * drive[0]; w17 = w17 + w15; w17 = sigma[0] * w17; w17 = w17 / drive[16]; w16 = w0 * drive[5];
 w16 = w16 + w15; w16 = sigma[0] * w16; w16 = w16 / drive[16]; w17 = w17 - w16; w16 = R(2.0) * w17; w13 = w13 * w16;
 w17 = w14 * w17; w17 = R(0.25) * w17; w17 = w17 / w9; w17 = R(2.0) * w17; w8 = w8 * w17; w7 = R(0.25) * w8;
 w14 = w14 * w7; w13 = w13 - w14; w13 = w13 / drive[16]; w6 = sigma[0] * w13; w2 = w2 * w6; w0 = w0 * w6; w2 = w2 - w0;
 r3 = w2; w12 = drive[14] * w2; r4 = w12; w10 = drive[5] * w2; r5 = w10; bend[0] += r0; bend[1] += r1; bend[4] += r2;
 bend[2] += r3; bend[5] += r4; bend[8] += r5;
}

static void worm_stribeck_exponential_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, r0, r1, r2; w8 = drive[0] * v[1]; w9 = sigma[0] * w8;
 w9 = V(fabs)(w9); w9 = w9 / drive[10]; w5 = (-R(2.0)) * w9; w4 = V(exp)(w5); w3 = drive[9] * w4; w2 = drive[8] + w3;
 w2 = w2 * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w9 = drive[2] * w2; w10 = R(1.0) - w9; w3 = w3 / w10;
 w11 = drive[5] * v[2]; w10 = v[0] + w11; w11 = drive[13] * sigma[0]; w10 = w10 + w11; w11 = drive[14] * v[1];
 w10 = w10 + w11; w3 = w3 * w10; w6 = drive[0] * v[2]; w11 = drive[4] * w6; w3 = w3 + w11; w6 = drive[11] * sigma[0];
 w3 = w3 + w6; w12 = drive[12] * w8; w3 = w3 + w12; w3 = sigma[0] * w3; w7 = w3 / drive[15]; r0 = w7;
 w1 = drive[2] - w2; w1 = w1 * drive[1]; w5 = R(1.0) + w9; w1 = w1 / w5; w1 = w1 * w10; w1 = w1 + w11; w1 = w1 + w6;
 w1 = w1 + w12; w0 = sigma[0] * w1; w1 = w0 / drive[15]; r1 = w1; w1 = w3 + w0; w8 = R(2.0) * drive[15]; w1 = w1 / w8;
 w3 = w3 - w0; w3 = w3 / w8; w3 = w3 * w3; w3 = w3 + R(1e-06); w3 = V(sqrt)(w3); w1 = w1 + w3; w1 = w1 - R(0.001);
 w1 = -w1; r2 = w1; g[0] = r0; g[1] = r1; g[2] = r2;
}

static void worm_stribeck_exponential_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w19, w20, w21, w22, w23, w24, w25;
 real r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11; w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w10 = V(fabs)(w9);
 w10 = w10 / drive[10]; w10 = (-R(2.0)) * w10; w4 = V(exp)(w10); w10 = drive[9] * w4; w2 = drive[8] + w10;
 w2 = w2 * drive[3]; w12 = drive[2] + w2; w12 = w12 * drive[1]; w15 = drive[2] * w2; w16 = R(1.0) - w15;
 w12 = w12 / w16; w20 = drive[5] * v[2]; w17 = v[0] + w20; w20 = drive[13] * sigma[0]; w17 = w17 + w20;
 w7 = drive[14] * v[1]; w17 = w17 + w7; w7 = w12 * w17; w19 = drive[0] * v[2]; w19 = drive[4] * w19; w7 = w7 + w19;
 w22 = drive[11] * sigma[0]; w7 = w7 + w22; w8 = drive[12] * w8; w7 = w7 + w8; w7 = sigma[0] * w7; w25 = w7 / drive[15];
 r0 = w25; w2 = drive[2] - w2; w2 = w2 * drive[1]; w14 = R(1.0) + w15; w2 = w2 / w14; w15 = w2 * w17; w15 = w15 + w19;
 w15 = w15 + w22; w15 = w15 + w8; w15 = sigma[0] * w15; w8 = w15 / drive[15]; r1 = w8; w8 = w7 + w15;
 w22 = R(2.0) * drive[15]; w8 = w8 / w22; w7 = w7 - w15; w7 = w7 / w22; w15 = w7 * w7; w15 = w15 + R(1e-06);
 w15 = V(sqrt)(w15); w8 = w8 + w15; w8 = w8 - R(0.001); w8 = -w8; r2 = w8; w8 = sigma[0] * w12; w19 = w8 / drive[15];
 r3 = w19; w19 = sigma[0] * w2; w25 = w19 / drive[15]; r4 = w25; w25 = w8 + w19; w25 = w25 / w22; w7 = R(2.0) * w7;
 w8 = w8 - w19; w8 = w8 / w22; w8 = w7 * w8; w15 = R(2.0) * w15; w8 = w8 / w15; w25 = w25 + w8; w25 = -w25; r5 = w25;
 w9 = sign_of(w9); w25 = sigma[0] * drive[0]; w9 = w9 * w25; w9 = w9 / drive[10]; w5 = (-R(2.0)) * w9; w4 = w4 * w5;
 w3 = drive[9] * w4; w10 = drive[3] * w3; w13 = drive[1] * w10; w3 = w13 / w16; w16 = w12 / w16; w1 = drive[2] * w10;
 w16 = w16 * w1; w3 = w3 + w16; w3 = w17 * w3; w16 = w12 * drive[14]; w3 = w3 + w16; w23 = drive[12] * drive[0];
 w3 = w3 + w23; w3 = sigma[0] * w3; w16 = w3 / drive[15]; r6 = w16; w20 = w2 * drive[14]; w13 = w13 / w14;
 w14 = w2 / w14; w14 = w14 * w1; w13 = w13 + w14; w17 = w17 * w13; w20 = w20 - w17; w20 = w20 + w23;
 w20 = sigma[0] * w20; w23 = w20 / drive[15]; r7 = w23; w23 = w3 + w20; w23 = w23 / w22; w3 = w3 - w20; w3 = w3 / w22;
 w3 = w7 * w3; w3 = w3 / w15; w23 = w23 + w3; w23 = -w23; r8 = w23; w12 = w12 * drive[5]; w21 = drive[4] * drive[0];
 w12 = w12 + w21; w12 = sigma[0] * w12; w6 = w12 / drive[15]; r9 = w6; w2 = w2 * drive[5]; w2 = w2 + w21;
 w0 = sigma[0] * w2; w24 = w0 / drive[15]; r10 = w24; w24 = w12 + w0; w24 = w24 / w22; w12 = w12 - w0; w12 = w12 / w22;
 w7 = w7 * w12; w7 = w7 / w15; w24 = w24 + w7; w24 = -w24; r11 = w24; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3;
 by[3] = r4; by[6] = r5; by[1] = r6; by[4] = r7; by[7] = r8; by[2] = r9; by[5] = r10; by[8] = r11;
}

static void worm_stribeck_exponential_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35, w36; real w37, w38, r0, r1, r2, r3, r4, r5;
 w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w10 = V(fabs)(w9); w10 = w10 / drive[10]; w10 = (-R(2.0)) * w10;
 w3 = V(exp)(w10); w10 = drive[9] * w3; w1 = drive[8] + w10; w1 = w1 * drive[3]; w12 = drive[2] - w1;
 w12 = w12 * drive[1]; w15 = drive[2] * w1; w16 = R(1.0) + w15; w12 = w12 / w16; w1 = drive[2] + w1; w1 = w1 * drive[1];
 w14 = R(1.0) - w15; w1 = w1 / w14; w20 = drive[5] * v[2]; w15 = v[0] + w20; w20 = drive[13] * sigma[0];
 w15 = w15 + w20; w7 = drive[14] * v[1]; w15 = w15 + w7; w7 = w1 * w15; w19 = drive[0] * v[2]; w19 = drive[4] * w19;
 w7 = w7 + w19; w22 = drive[11] * sigma[0]; w7 = w7 + w22; w8 = drive[12] * w8; w7 = w7 + w8; w7 = sigma[0] * w7;
 w24 = w12 * w15; w24 = w24 + w19; w24 = w24 + w22; w24 = w24 + w8; w24 = sigma[0] * w24; w7 = w7 - w24;
 w8 = R(2.0) * drive[15]; w7 = w7 / w8; w22 = w7 * w7; w22 = w22 + R(1e-06); w22 = V(sqrt)(w22); w22 = R(2.0) * w22;
 w19 = lam[2] / w22; w25 = sigma[0] * w1; w26 = sigma[0] * w12; w25 = w25 - w26; w25 = w25 / w8; w26 = R(2.0) * w25;
 w26 = w19 * w26; w7 = R(2.0) * w7; w27 = w19 / w22; w25 = w7 * w25; w25 = w25 / w22; w25 = R(2.0) * w25;
 w25 = w27 * w25; w25 = w7 * w25; w26 = w26 - w25; w26 = w26 / w8; w26 = sigma[0] * w26; w25 = w12 * w26;
 w26 = w1 * w26; w25 = w25 - w26; r0 = w25; w9 = sign_of(w9); w25 = sigma[0] * drive[0]; w25 = w9 * w25;
 w25 = w25 / drive[10]; w25 = (-R(2.0)) * w25; w25 = w3 * w25; w26 = drive[9] * w25; w26 = drive[3] * w26;
 w28 = drive[1] * w26; w29 = w28 / w14; w30 = w1 / w14; w26 = drive[2] * w26; w31 = w30 * w26; w29 = w29 + w31;
 w31 = w15 * w29; w32 = w1 * drive[14]; w31 = w31 + w32; w23 = drive[12] * drive[0]; w31 = w31 + w23;
 w31 = sigma[0] * w31; w32 = w12 * drive[14]; w28 = w28 / w16; w33 = w12 / w16; w34 = w33 * w26; w28 = w28 + w34;
 w34 = w15 * w28; w32 = w32 - w34; w32 = w32 + w23; w32 = sigma[0] * w32; w31 = w31 - w32; w31 = w31 / w8;
 w32 = R(2.0) * w31; w32 = w19 * w32; w31 = w7 * w31; w31 = w31 / w22; w31 = R(2.0) * w31; w31 = w27 * w31;
 w31 = w7 * w31; w32 = w32 - w31; w32 = w32 / w8; w32 = sigma[0] * w32; w31 = w12 * w32; w23 = w7 * w19; w23 = w23 / w8;
 w17 = lam[2] / w8; w34 = w23 - w17; w35 = lam[1] / drive[15]; w34 = w34 + w35; w34 = sigma[0] * w34; w35 = w34 * w28;
 w31 = w31 - w35; w35 = lam[0] / drive[15]; w23 = w23 + w17; w35 = w35 - w23; w35 = sigma[0] * w35; w23 = w35 * w29;
 w17 = w1 * w32; w23 = w23 - w17; w31 = w31 + w23; r1 = w31; w31 = drive[14] * w31; w23 = w15 * w35; w17 = w30 * w23;
 w24 = w15 * w34; w36 = w33 * w24; w17 = w17 - w36; w17 = drive[2] * w17; w36 = w24 / w16; w37 = drive[1] * w36;
 w17 = w17 - w37; w37 = w23 / w14; w38 = drive[1] * w37; w17 = w17 + w38; w17 = drive[3] * w17; w17 = drive[9] * w17;
 w17 = w17 * w25; w29 = w29 / w14; w25 = w30 / w14; w25 = w25 * w26; w29 = w29 + w25; w23 = w23 * w29;
 w29 = w35 * drive[14]; w32 = w15 * w32; w29 = w29 - w32; w25 = w30 * w29; w23 = w23 + w25; w25 = w34 * drive[14];
 w25 = w25 + w32; w32 = w33 * w25; w28 = w28 / w16; w38 = w33 / w16; w38 = w38 * w26; w28 = w28 + w38; w24 = w24 * w28;
 w32 = w32 - w24; w23 = w23 - w32; w23 = drive[2] * w23; w25 = w25 / w16; w36 = w36 / w16; w36 = w36 * w26;
 w25 = w25 - w36; w25 = drive[1] * w25; w23 = w23 - w25; w29 = w29 / w14; w37 = w37 / w14; w37 = w37 * w26;
 w29 = w29 + w37; w29 = drive[1] * w29; w23 = w23 + w29; w23 = drive[3] * w23; w23 = drive[9] * w23; w23 = w3 * w23;
 w17 = w17 + w23; w17 = (-R(2.0)) * w17; w17 = w17 / drive[10]; w17 = w9 * w17; w17 = sigma[0] * w17;
 w17 = drive[0] * w17; w31 = w31 + w17; r2 = w31; w31 = w1 * drive[5]; w21 = drive[4] * drive[0]; w31 = w31 + w21;
 w31 = sigma[0] * w31; w17 = w12 * drive[5]; w17 = w17 + w21; w17 = sigma[0] * w17; w31 = w31 - w17; w31 = w31 / w8;
 w17 = R(2.0) * w31; w19 = w19 * w17; w31 = w7 * w31; w31 = w31 / w22; w31 = R(2.0) * w31; w27 = w27 * w31;
 w7 = w7 * w27; w19 = w19 - w7; w19 = w19 / w8; w19 = sigma[0] * w19; w12 = w12 * w19; w1 = w1 * w19; w12 = w12 - w1;
 r3 = w12; w20 = drive[14] * w12; w35 = w35 * drive[5]; w15 = w15 * w19; w35 = w35 - w15; w30 = w30 * w35;
 w34 = w34 * drive[5]; w34 = w34 + w15; w33 = w33 * w34; w30 = w30 - w33; w0 = drive[2] * w30; w34 = w34 / w16;
 w34 = drive[1] * w34; w0 = w0 - w34; w35 = w35 / w14; w13 = drive[1] * w35; w0 = w0 + w13; w10 = drive[3] * w0;
 w2 = drive[9] * w10; w3 = w3 * w2; w4 = (-R(2.0)) * w3; w4 = w4 / drive[10]; w9 = w9 * w4; w5 = sigma[0] * w9;
 w6 = drive[0] * w5; w20 = w20 + w6; r4 = w20; w18 = drive[5] * w12; r5 = w18; bend[0] += r0; bend[1] += r1;
 bend[4] += r2; bend[2] += r3; bend[5] += r4; bend[8] += r5;
}

static void worm_stribeck_exponential_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w8, w9, w10, w11, w12; real r0; w8 = drive[0] * v[1]; w9 = sigma[0] * w8;
 w9 = V(fabs)(w9); w9 = w9 / drive[10]; w5 = (-R(2.0)) * w9; w4 = V(exp)(w5); w3 = drive[9] * w4; w2 = drive[8] + w3;
 w2 = w2 * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w9 = drive[2] * w2; w10 = R(1.0) - w9; w3 = w3 / w10;
 w11 = drive[5] * v[2]; w10 = v[0] + w11; w11 = drive[13] * sigma[0]; w10 = w10 + w11; w11 = drive[14] * v[1];
 w10 = w10 + w11; w3 = w3 * w10; w6 = drive[0] * v[2]; w11 = drive[4] * w6; w3 = w3 + w11; w6 = drive[11] * sigma[0];
 w3 = w3 + w6; w12 = drive[12] * w8; w3 = w3 + w12; w3 = sigma[0] * w3; w3 = w3 / drive[16]; w1 = drive[2] - w2;
 w1 = w1 * drive[1]; w5 = R(1.0) + w9; w1 = w1 / w5; w1 = w1 * w10; w1 = w1 + w11; w1 = w1 + w6; w1 = w1 + w12;
 w0 = sigma[0] * w1; w0 = w0 / drive[16]; w8 = w3 + w0; w8 = w8 / R(2.0); w3 = w3 - w0; w3 = w3 * w3; w3 = w3 / R(4.0);
 w3 = w3 + R(0.0001); w3 = V(sqrt)(w3); w8 = w8 + w3; r0 = w8; g[0] = r0;
}

static void worm_stribeck_exponential_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real r0, r1, r2, r3; w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w10 = V(fabs)(w9); w10 = w10 / drive[10];
 w10 = (-R(2.0)) * w10; w4 = V(exp)(w10); w10 = drive[9] * w4; w2 = drive[8] + w10; w2 = w2 * drive[3];
 w12 = drive[2] + w2; w12 = w12 * drive[1]; w15 = drive[2] * w2; w16 = R(1.0) - w15; w12 = w12 / w16;
 w20 = drive[5] * v[2]; w17 = v[0] + w20; w20 = drive[13] * sigma[0]; w17 = w17 + w20; w7 = drive[14] * v[1];
 w17 = w17 + w7; w7 = w12 * w17; w19 = drive[0] * v[2]; w19 = drive[4] * w19; w7 = w7 + w19; w22 = drive[11] * sigma[0];
 w7 = w7 + w22; w8 = drive[12] * w8; w7 = w7 + w8; w7 = sigma[0] * w7; w7 = w7 / drive[16]; w2 = drive[2] - w2;
 w2 = w2 * drive[1]; w14 = R(1.0) + w15; w2 = w2 / w14; w15 = w2 * w17; w15 = w15 + w19; w15 = w15 + w22;
 w15 = w15 + w8; w15 = sigma[0] * w15; w15 = w15 / drive[16]; w8 = w7 + w15; w8 = w8 / R(2.0); w7 = w7 - w15;
 w15 = w7 * w7; w15 = w15 / R(4.0); w15 = w15 + R(0.0001); w15 = V(sqrt)(w15); w8 = w8 + w15; r0 = w8; w7 = R(2.0) * w7;
 w15 = R(2.0) * w15; w22 = R(0.25) / w15; w7 = w7 * w22; w22 = R(0.5) - w7; w22 = w22 / drive[16]; w22 = sigma[0] * w22;
 w15 = w2 * w22; w7 = w7 + R(0.5); w7 = w7 / drive[16]; w7 = sigma[0] * w7; w24 = w12 * w7; w15 = w15 + w24; r1 = w15;
 w20 = drive[14] * w15; w24 = w22 + w7; w23 = drive[12] * w24; w9 = sign_of(w9); w12 = w12 / w16; w7 = w17 * w7;
 w12 = w12 * w7; w2 = w2 / w14; w17 = w17 * w22; w2 = w2 * w17; w12 = w12 - w2; w1 = drive[2] * w12; w17 = w17 / w14;
 w17 = drive[1] * w17; w1 = w1 - w17; w7 = w7 / w16; w13 = drive[1] * w7; w1 = w1 + w13; w10 = drive[3] * w1;
 w3 = drive[9] * w10; w4 = w4 * w3; w5 = (-R(2.0)) * w4; w5 = w5 / drive[10]; w9 = w9 * w5; w0 = sigma[0] * w9;
 w23 = w23 + w0; w23 = drive[0] * w23; w20 = w20 + w23; r2 = w20; w21 = drive[4] * w24; w6 = drive[0] * w21;
 w18 = drive[5] * w15; w6 = w6 + w18; r3 = w6; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void worm_stribeck_exponential_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w27, w28, w29, w30, w31, w32, w33, w34, w35, w36, w37; real w38, w39, r0, r1, r2, r3, r4, r5;
 w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w10 = V(fabs)(w9); w10 = w10 / drive[10]; w10 = (-R(2.0)) * w10;
 w3 = V(exp)(w10); w10 = drive[9] * w3; w1 = drive[8] + w10; w1 = w1 * drive[3]; w12 = drive[2] + w1;
 w12 = w12 * drive[1]; w15 = drive[2] * w1; w16 = R(1.0) - w15; w12 = w12 / w16; w22 = drive[5] * v[2];
 w19 = v[0] + w22; w22 = drive[13] * sigma[0]; w19 = w19 + w22; w7 = drive[14] * v[1]; w19 = w19 + w7; w7 = w12 * w19;
 w21 = drive[0] * v[2]; w21 = drive[4] * w21; w7 = w7 + w21; w24 = drive[11] * sigma[0]; w7 = w7 + w24;
 w8 = drive[12] * w8; w7 = w7 + w8; w7 = sigma[0] * w7; w7 = w7 / drive[16]; w1 = drive[2] - w1; w1 = w1 * drive[1];
 w14 = R(1.0) + w15; w1 = w1 / w14; w15 = w1 * w19; w15 = w15 + w21; w15 = w15 + w24; w15 = w15 + w8;
 w15 = sigma[0] * w15; w15 = w15 / drive[16]; w7 = w7 - w15; w15 = w7 * w7; w15 = w15 / R(4.0); w15 = w15 + R(0.0001);
 w15 = V(sqrt)(w15); w15 = R(2.0) * w15; w8 = lam[0] / w15; w24 = R(0.25) * w8; w21 = sigma[0] * w12;
 w21 = w21 / drive[16]; w27 = sigma[0] * w1; w27 = w27 / drive[16]; w21 = w21 - w27; w27 = R(2.0) * w21;
 w27 = w24 * w27; w7 = R(2.0) * w7; w8 = w8 / w15; w21 = w7 * w21; w21 = R(0.25) * w21; w21 = w21 / w15;
 w21 = R(2.0) * w21; w21 = w8 * w21; w21 = R(0.25) * w21; w21 = w7 * w21; w27 = w27 - w21; w27 = w27 / drive[16];
 w27 = sigma[0] * w27; w21 = w12 * w27; w27 = w1 * w27; w21 = w21 - w27; r0 = w21; w21 = w7 * w24;
 w27 = R(0.5) * lam[0]; w18 = w21 + w27; w18 = w18 / drive[16]; w18 = sigma[0] * w18; w9 = sign_of(w9);
 w28 = sigma[0] * drive[0]; w28 = w9 * w28; w28 = w28 / drive[10]; w28 = (-R(2.0)) * w28; w28 = w3 * w28;
 w29 = drive[9] * w28; w29 = drive[3] * w29; w30 = drive[1] * w29; w31 = w30 / w16; w32 = w12 / w16;
 w29 = drive[2] * w29; w33 = w32 * w29; w31 = w31 + w33; w33 = w18 * w31; w34 = w19 * w31; w35 = w12 * drive[14];
 w34 = w34 + w35; w25 = drive[12] * drive[0]; w34 = w34 + w25; w34 = sigma[0] * w34; w34 = w34 / drive[16];
 w35 = w1 * drive[14]; w30 = w30 / w14; w36 = w1 / w14; w37 = w36 * w29; w30 = w30 + w37; w37 = w19 * w30;
 w35 = w35 - w37; w35 = w35 + w25; w35 = sigma[0] * w35; w35 = w35 / drive[16]; w34 = w34 - w35; w35 = R(2.0) * w34;
 w35 = w24 * w35; w34 = w7 * w34; w34 = R(0.25) * w34; w34 = w34 / w15; w34 = R(2.0) * w34; w34 = w8 * w34;
 w34 = R(0.25) * w34; w34 = w7 * w34; w35 = w35 - w34; w35 = w35 / drive[16]; w35 = sigma[0] * w35; w34 = w12 * w35;
 w33 = w33 + w34; w27 = w27 - w21; w27 = w27 / drive[16]; w27 = sigma[0] * w27; w21 = w27 * w30; w34 = w1 * w35;
 w21 = w21 + w34; w33 = w33 - w21; r1 = w33; w33 = drive[14] * w33; w21 = w19 * w18; w34 = w32 * w21; w25 = w19 * w27;
 w37 = w36 * w25; w34 = w34 - w37; w34 = drive[2] * w34; w37 = w25 / w14; w38 = drive[1] * w37; w34 = w34 - w38;
 w38 = w21 / w16; w39 = drive[1] * w38; w34 = w34 + w39; w34 = drive[3] * w34; w34 = drive[9] * w34; w34 = w34 * w28;
 w31 = w31 / w16; w28 = w32 / w16; w28 = w28 * w29; w31 = w31 + w28; w21 = w21 * w31; w31 = w18 * drive[14];
 w35 = w19 * w35; w31 = w31 + w35; w28 = w32 * w31; w21 = w21 + w28; w28 = w27 * drive[14]; w28 = w28 - w35;
 w35 = w36 * w28; w30 = w30 / w14; w39 = w36 / w14; w39 = w39 * w29; w30 = w30 + w39; w25 = w25 * w30; w35 = w35 - w25;
 w21 = w21 - w35; w21 = drive[2] * w21; w28 = w28 / w14; w37 = w37 / w14; w37 = w37 * w29; w28 = w28 - w37;
 w28 = drive[1] * w28; w21 = w21 - w28; w31 = w31 / w16; w38 = w38 / w16; w38 = w38 * w29; w31 = w31 + w38;
 w31 = drive[1] * w31; w21 = w21 + w31; w21 = drive[3] * w21; w21 = drive[9] * w21; w21 = w3 * w21; w34 = w34 + w21;
 w34 = (-R(2.0)) * w34; w34 = w34 / drive[10]; w34 = w9 * w34; w34 = sigma[0] * w34; w34 = drive[0] * w34;
 w33 = w33 + w34; r2 = w33; w33 = w12 * drive[5]; w23 = drive[4] * drive[0]; w33 = w33 + w23; w33 = sigma[0] * w33;
 w33 = w33 / drive[16]; w34 = w1 * drive[5]; w34 = w34 + w23; w34 = sigma[0] * w34; w34 = w34 / drive[16];
 w33 = w33 - w34; w34 = R(2.0) * w33; w24 = w24 * w34; w33 = w7 * w33; w33 = R(0.25) * w33; w33 = w33 / w15;
 w33 = R(2.0) * w33; w8 = w8 * w33; w17 = R(0.25) * w8; w7 = w7 * w17; w24 = w24 - w7; w24 = w24 / drive[16];
 w24 = sigma[0] * w24; w12 = w12 * w24; w1 = w1 * w24; w12 = w12 - w1; r3 = w12; w22 = drive[14] * w12;
 w18 = w18 * drive[5]; w19 = w19 * w24; w18 = w18 + w19; w32 = w32 * w18; w27 = w27 * drive[5]; w27 = w27 - w19;
 w36 = w36 * w27; w32 = w32 - w36; w0 = drive[2] * w32; w27 = w27 / w14; w27 = drive[1] * w27; w0 = w0 - w27;
 w18 = w18 / w16; w13 = drive[1] * w18; w0 = w0 + w13; w10 = drive[3] * w0; w2 = drive[9] * w10; w3 = w3 * w2;
 w4 = (-R(2.0)) * w3; w4 = w4 / drive[10]; w9 = w9 * w4; w5 = sigma[0] * w9; w6 = drive[0] * w5; w22 = w22 + w6;
 r4 = w22; w20 = drive[5] * w12; r5 = w20; bend[0] += r0; bend[1] += r1; bend[4] += r2; bend[2] += r3; bend[5] += r4;
 bend[8] += r5;
}

static void worm_stribeck_gaussian_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w12, r0, r1, r2; w7 = drive[0] * v[1]; w8 = sigma[0] * w7;
 w8 = V(fabs)(w8); w8 = w8 / drive[10]; w8 = w8 * w8; w8 = -w8; w4 = V(exp)(w8); w3 = drive[9] * w4; w2 = drive[8] + w3;
 w2 = w2 * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w9 = drive[2] * w2; w10 = R(1.0) - w9; w3 = w3 / w10;
 w11 = drive[5] * v[2]; w10 = v[0] + w11; w11 = drive[13] * sigma[0]; w10 = w10 + w11; w11 = drive[14] * v[1];
 w10 = w10 + w11; w3 = w3 * w10; w5 = drive[0] * v[2]; w11 = drive[4] * w5; w3 = w3 + w11; w5 = drive[11] * sigma[0];
 w3 = w3 + w5; w12 = drive[12] * w7; w3 = w3 + w12; w3 = sigma[0] * w3; w6 = w3 / drive[15]; r0 = w6;
 w1 = drive[2] - w2; w1 = w1 * drive[1]; w8 = R(1.0) + w9; w1 = w1 / w8; w1 = w1 * w10; w1 = w1 + w11; w1 = w1 + w5;
 w1 = w1 + w12; w0 = sigma[0] * w1; w1 = w0 / drive[15]; r1 = w1; w1 = w3 + w0; w7 = R(2.0) * drive[15]; w1 = w1 / w7;
 w3 = w3 - w0; w3 = w3 / w7; w3 = w3 * w3; w3 = w3 + R(1e-06); w3 = V(sqrt)(w3); w1 = w1 + w3; w1 = w1 - R(0.001);
 w1 = -w1; r2 = w1; g[0] = r0; g[1] = r1; g[2] = r2;
}

static void worm_stribeck_gaussian_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w11, w12; real w13, w14, w15, w16, w17, w19, w20, w21, w22, w23, w24, w25;
 real r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11; w7 = drive[0] * v[1]; w8 = sigma[0] * w7; w9 = V(fabs)(w8);
 w9 = w9 / drive[10]; w11 = w9 * w9; w11 = -w11; w4 = V(exp)(w11); w11 = drive[9] * w4; w2 = drive[8] + w11;
 w2 = w2 * drive[3]; w12 = drive[2] + w2; w12 = w12 * drive[1]; w15 = drive[2] * w2; w16 = R(1.0) - w15;
 w12 = w12 / w16; w20 = drive[5] * v[2]; w17 = v[0] + w20; w20 = drive[13] * sigma[0]; w17 = w17 + w20;
 w6 = drive[14] * v[1]; w17 = w17 + w6; w6 = w12 * w17; w19 = drive[0] * v[2]; w19 = drive[4] * w19; w6 = w6 + w19;
 w22 = drive[11] * sigma[0]; w6 = w6 + w22; w7 = drive[12] * w7; w6 = w6 + w7; w6 = sigma[0] * w6; w25 = w6 / drive[15];
 r0 = w25; w2 = drive[2] - w2; w2 = w2 * drive[1]; w14 = R(1.0) + w15; w2 = w2 / w14; w15 = w2 * w17; w15 = w15 + w19;
 w15 = w15 + w22; w15 = w15 + w7; w15 = sigma[0] * w15; w7 = w15 / drive[15]; r1 = w7; w7 = w6 + w15;
 w22 = R(2.0) * drive[15]; w7 = w7 / w22; w6 = w6 - w15; w6 = w6 / w22; w15 = w6 * w6; w15 = w15 + R(1e-06);
 w15 = V(sqrt)(w15); w7 = w7 + w15; w7 = w7 - R(0.001); w7 = -w7; r2 = w7; w7 = sigma[0] * w12; w19 = w7 / drive[15];
 r3 = w19; w19 = sigma[0] * w2; w25 = w19 / drive[15]; r4 = w25; w25 = w7 + w19; w25 = w25 / w22; w6 = R(2.0) * w6;
 w7 = w7 - w19; w7 = w7 / w22; w7 = w6 * w7; w15 = R(2.0) * w15; w7 = w7 / w15; w25 = w25 + w7; w25 = -w25; r5 = w25;
 w25 = w12 * drive[14]; w9 = R(2.0) * w9; w8 = sign_of(w8); w7 = sigma[0] * drive[0]; w8 = w8 * w7; w8 = w8 / drive[10];
 w9 = w9 * w8; w4 = w4 * w9; w3 = drive[9] * w4; w11 = drive[3] * w3; w13 = drive[1] * w11; w3 = w13 / w16;
 w16 = w12 / w16; w1 = drive[2] * w11; w16 = w16 * w1; w3 = w3 + w16; w3 = w17 * w3; w25 = w25 - w3;
 w23 = drive[12] * drive[0]; w25 = w25 + w23; w25 = sigma[0] * w25; w3 = w25 / drive[15]; r6 = w3; w13 = w13 / w14;
 w14 = w2 / w14; w14 = w14 * w1; w13 = w13 + w14; w17 = w17 * w13; w20 = w2 * drive[14]; w17 = w17 + w20;
 w17 = w17 + w23; w17 = sigma[0] * w17; w23 = w17 / drive[15]; r7 = w23; w23 = w25 + w17; w23 = w23 / w22;
 w25 = w25 - w17; w25 = w25 / w22; w25 = w6 * w25; w25 = w25 / w15; w23 = w23 + w25; w23 = -w23; r8 = w23;
 w12 = w12 * drive[5]; w21 = drive[4] * drive[0]; w12 = w12 + w21; w12 = sigma[0] * w12; w5 = w12 / drive[15]; r9 = w5;
 w2 = w2 * drive[5]; w2 = w2 + w21; w0 = sigma[0] * w2; w24 = w0 / drive[15]; r10 = w24; w24 = w12 + w0;
 w24 = w24 / w22; w12 = w12 - w0; w12 = w12 / w22; w6 = w6 * w12; w6 = w6 / w15; w24 = w24 + w6; w24 = -w24; r11 = w24;
 g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[3] = r4; by[6] = r5; by[1] = r6; by[4] = r7; by[7] = r8; by[2] = r9;
 by[5] = r10; by[8] = r11;
}

static void worm_stribeck_gaussian_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w11, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, w33, w34, w35, w36; real w37, w38, w39, w40, w41, r0, r1, r2, r3, r4, r5;
 w7 = drive[0] * v[1]; w8 = sigma[0] * w7; w9 = V(fabs)(w8); w9 = w9 / drive[10]; w11 = w9 * w9; w11 = -w11;
 w3 = V(exp)(w11); w11 = drive[9] * w3; w1 = drive[8] + w11; w1 = w1 * drive[3]; w12 = drive[2] - w1;
 w12 = w12 * drive[1]; w15 = drive[2] * w1; w16 = R(1.0) + w15; w12 = w12 / w16; w1 = drive[2] + w1; w1 = w1 * drive[1];
 w14 = R(1.0) - w15; w1 = w1 / w14; w20 = drive[5] * v[2]; w15 = v[0] + w20; w20 = drive[13] * sigma[0];
 w15 = w15 + w20; w6 = drive[14] * v[1]; w15 = w15 + w6; w6 = w1 * w15; w19 = drive[0] * v[2]; w19 = drive[4] * w19;
 w6 = w6 + w19; w22 = drive[11] * sigma[0]; w6 = w6 + w22; w7 = drive[12] * w7; w6 = w6 + w7; w6 = sigma[0] * w6;
 w24 = w12 * w15; w24 = w24 + w19; w24 = w24 + w22; w24 = w24 + w7; w24 = sigma[0] * w24; w6 = w6 - w24;
 w7 = R(2.0) * drive[15]; w6 = w6 / w7; w22 = w6 * w6; w22 = w22 + R(1e-06); w22 = V(sqrt)(w22); w22 = R(2.0) * w22;
 w19 = lam[2] / w22; w25 = sigma[0] * w1; w26 = sigma[0] * w12; w25 = w25 - w26; w25 = w25 / w7; w26 = R(2.0) * w25;
 w26 = w19 * w26; w6 = R(2.0) * w6; w27 = w19 / w22; w25 = w6 * w25; w25 = w25 / w22; w25 = R(2.0) * w25;
 w25 = w27 * w25; w25 = w6 * w25; w26 = w26 - w25; w26 = w26 / w7; w26 = sigma[0] * w26; w25 = w12 * w26;
 w26 = w1 * w26; w25 = w25 - w26; r0 = w25; w25 = w6 * w19; w25 = w25 / w7; w17 = lam[2] / w7; w26 = w25 - w17;
 w28 = lam[1] / drive[15]; w26 = w26 + w28; w26 = sigma[0] * w26; w9 = R(2.0) * w9; w8 = sign_of(w8);
 w28 = sigma[0] * drive[0]; w28 = w8 * w28; w28 = w28 / drive[10]; w29 = w9 * w28; w29 = w3 * w29; w30 = drive[9] * w29;
 w30 = drive[3] * w30; w31 = drive[1] * w30; w32 = w31 / w16; w33 = w12 / w16; w30 = drive[2] * w30; w34 = w33 * w30;
 w32 = w32 + w34; w34 = w26 * w32; w35 = w1 * drive[14]; w31 = w31 / w14; w36 = w1 / w14; w37 = w36 * w30;
 w31 = w31 + w37; w37 = w15 * w31; w35 = w35 - w37; w23 = drive[12] * drive[0]; w35 = w35 + w23; w35 = sigma[0] * w35;
 w37 = w15 * w32; w38 = w12 * drive[14]; w37 = w37 + w38; w37 = w37 + w23; w37 = sigma[0] * w37; w35 = w35 - w37;
 w35 = w35 / w7; w37 = R(2.0) * w35; w37 = w19 * w37; w35 = w6 * w35; w35 = w35 / w22; w35 = R(2.0) * w35;
 w35 = w27 * w35; w35 = w6 * w35; w37 = w37 - w35; w37 = w37 / w7; w37 = sigma[0] * w37; w35 = w12 * w37;
 w34 = w34 + w35; w35 = lam[0] / drive[15]; w25 = w25 + w17; w35 = w35 - w25; w35 = sigma[0] * w35; w25 = w35 * w31;
 w17 = w1 * w37; w25 = w25 + w17; w34 = w34 - w25; r1 = w34; w34 = drive[14] * w34; w25 = w15 * w35; w17 = w36 * w25;
 w24 = w15 * w26; w23 = w33 * w24; w17 = w17 - w23; w17 = drive[2] * w17; w23 = w24 / w16; w38 = drive[1] * w23;
 w17 = w17 - w38; w38 = w25 / w14; w39 = drive[1] * w38; w17 = w17 + w39; w17 = drive[3] * w17; w17 = drive[9] * w17;
 w39 = w3 * w17; w28 = R(2.0) * w28; w39 = w39 * w28; w28 = w35 * drive[14]; w37 = w15 * w37; w28 = w28 - w37;
 w40 = w36 * w28; w31 = w31 / w14; w41 = w36 / w14; w41 = w41 * w30; w31 = w31 + w41; w25 = w25 * w31; w40 = w40 - w25;
 w32 = w32 / w16; w25 = w33 / w16; w25 = w25 * w30; w32 = w32 + w25; w24 = w24 * w32; w32 = w26 * drive[14];
 w32 = w32 + w37; w37 = w33 * w32; w24 = w24 + w37; w40 = w40 - w24; w40 = drive[2] * w40; w32 = w32 / w16;
 w23 = w23 / w16; w23 = w23 * w30; w32 = w32 + w23; w32 = drive[1] * w32; w40 = w40 - w32; w28 = w28 / w14;
 w38 = w38 / w14; w38 = w38 * w30; w28 = w28 - w38; w28 = drive[1] * w28; w40 = w40 + w28; w40 = drive[3] * w40;
 w40 = drive[9] * w40; w40 = w3 * w40; w17 = w17 * w29; w40 = w40 - w17; w40 = w9 * w40; w39 = w39 + w40;
 w39 = w39 / drive[10]; w39 = w8 * w39; w39 = sigma[0] * w39; w39 = drive[0] * w39; w34 = w34 - w39; r2 = w34;
 w34 = w1 * drive[5]; w21 = drive[4] * drive[0]; w34 = w34 + w21; w34 = sigma[0] * w34; w39 = w12 * drive[5];
 w39 = w39 + w21; w39 = sigma[0] * w39; w34 = w34 - w39; w34 = w34 / w7; w39 = R(2.0) * w34; w19 = w19 * w39;
 w34 = w6 * w34; w34 = w34 / w22; w34 = R(2.0) * w34; w27 = w27 * w34; w6 = w6 * w27; w19 = w19 - w6; w19 = w19 / w7;
 w19 = sigma[0] * w19; w12 = w12 * w19; w1 = w1 * w19; w12 = w12 - w1; r3 = w12; w20 = drive[14] * w12;
 w35 = w35 * drive[5]; w15 = w15 * w19; w35 = w35 - w15; w36 = w36 * w35; w26 = w26 * drive[5]; w26 = w26 + w15;
 w33 = w33 * w26; w36 = w36 - w33; w0 = drive[2] * w36; w26 = w26 / w16; w26 = drive[1] * w26; w0 = w0 - w26;
 w35 = w35 / w14; w13 = drive[1] * w35; w0 = w0 + w13; w11 = drive[3] * w0; w2 = drive[9] * w11; w3 = w3 * w2;
 w9 = w9 * w3; w9 = w9 / drive[10]; w8 = w8 * w9; w4 = sigma[0] * w8; w5 = drive[0] * w4; w20 = w20 - w5; r4 = w20;
 w18 = drive[5] * w12; r5 = w18; bend[0] += r0; bend[1] += r1; bend[4] += r2; bend[2] += r3; bend[5] += r4;
 bend[8] += r5;
}

static void worm_stribeck_gaussian_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w7, w8, w9, w10, w11, w12; real r0; w7 = drive[0] * v[1]; w8 = sigma[0] * w7;
 w8 = V(fabs)(w8); w8 = w8 / drive[10]; w8 = w8 * w8; w8 = -w8; w4 = V(exp)(w8); w3 = drive[9] * w4; w2 = drive[8] + w3;
 w2 = w2 * drive[3]; w3 = drive[2] + w2; w3 = w3 * drive[1]; w9 = drive[2] * w2; w10 = R(1.0) - w9; w3 = w3 / w10;
 w11 = drive[5] * v[2]; w10 = v[0] + w11; w11 = drive[13] * sigma[0]; w10 = w10 + w11; w11 = drive[14] * v[1];
 w10 = w10 + w11; w3 = w3 * w10; w5 = drive[0] * v[2]; w11 = drive[4] * w5; w3 = w3 + w11; w5 = drive[11] * sigma[0];
 w3 = w3 + w5; w12 = drive[12] * w7; w3 = w3 + w12; w3 = sigma[0] * w3; w3 = w3 / drive[16]; w1 = drive[2] - w2;
 w1 = w1 * drive[1]; w8 = R(1.0) + w9; w1 = w1 / w8; w1 = w1 * w10; w1 = w1 + w11; w1 = w1 + w5; w1 = w1 + w12;
 w0 = sigma[0] * w1; w0 = w0 / drive[16]; w7 = w3 + w0; w7 = w7 / R(2.0); w3 = w3 - w0; w3 = w3 * w3; w3 = w3 / R(4.0);
 w3 = w3 + R(0.0001); w3 = V(sqrt)(w3); w7 = w7 + w3; r0 = w7; g[0] = r0;
}

static void worm_stribeck_gaussian_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w11, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real r0, r1, r2, r3; w7 = drive[0] * v[1]; w8 = sigma[0] * w7; w9 = V(fabs)(w8); w9 = w9 / drive[10]; w11 = w9 * w9;
 w11 = -w11; w4 = V(exp)(w11); w11 = drive[9] * w4; w2 = drive[8] + w11; w2 = w2 * drive[3]; w12 = drive[2] + w2;
 w12 = w12 * drive[1]; w15 = drive[2] * w2; w16 = R(1.0) - w15; w12 = w12 / w16; w20 = drive[5] * v[2];
 w17 = v[0] + w20; w20 = drive[13] * sigma[0]; w17 = w17 + w20; w6 = drive[14] * v[1]; w17 = w17 + w6; w6 = w12 * w17;
 w19 = drive[0] * v[2]; w19 = drive[4] * w19; w6 = w6 + w19; w22 = drive[11] * sigma[0]; w6 = w6 + w22;
 w7 = drive[12] * w7; w6 = w6 + w7; w6 = sigma[0] * w6; w6 = w6 / drive[16]; w2 = drive[2] - w2; w2 = w2 * drive[1];
 w14 = R(1.0) + w15; w2 = w2 / w14; w15 = w2 * w17; w15 = w15 + w19; w15 = w15 + w22; w15 = w15 + w7;
 w15 = sigma[0] * w15; w15 = w15 / drive[16]; w7 = w6 + w15; w7 = w7 / R(2.0); w6 = w6 - w15; w15 = w6 * w6;
 w15 = w15 / R(4.0); w15 = w15 + R(0.0001); w15 = V(sqrt)(w15); w7 = w7 + w15; r0 = w7; w6 = R(2.0) * w6;
 w15 = R(2.0) * w15; w22 = R(0.25) / w15; w6 = w6 * w22; w22 = R(0.5) - w6; w22 = w22 / drive[16]; w22 = sigma[0] * w22;
 w15 = w2 * w22; w6 = w6 + R(0.5); w6 = w6 / drive[16]; w6 = sigma[0] * w6; w24 = w12 * w6; w15 = w15 + w24; r1 = w15;
 w20 = drive[14] * w15; w24 = w22 + w6; w23 = drive[12] * w24; w8 = sign_of(w8); w9 = R(2.0) * w9; w12 = w12 / w16;
 w6 = w17 * w6; w12 = w12 * w6; w2 = w2 / w14; w17 = w17 * w22; w2 = w2 * w17; w12 = w12 - w2; w1 = drive[2] * w12;
 w17 = w17 / w14; w17 = drive[1] * w17; w1 = w1 - w17; w6 = w6 / w16; w13 = drive[1] * w6; w1 = w1 + w13;
 w11 = drive[3] * w1; w3 = drive[9] * w11; w4 = w4 * w3; w9 = w9 * w4; w9 = w9 / drive[10]; w8 = w8 * w9;
 w0 = sigma[0] * w8; w23 = w23 - w0; w23 = drive[0] * w23; w20 = w20 + w23; r2 = w20; w21 = drive[4] * w24;
 w5 = drive[0] * w21; w18 = drive[5] * w15; w5 = w5 + w18; r3 = w5; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void worm_stribeck_gaussian_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w11, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w27, w28, w29, w30, w31, w32, w33, w34, w35, w36, w37; real w38, w39, w40, w41, w42, r0, r1, r2, r3, r4, r5;
 w7 = drive[0] * v[1]; w8 = sigma[0] * w7; w9 = V(fabs)(w8); w9 = w9 / drive[10]; w11 = w9 * w9; w11 = -w11;
 w3 = V(exp)(w11); w11 = drive[9] * w3; w1 = drive[8] + w11; w1 = w1 * drive[3]; w12 = drive[2] + w1;
 w12 = w12 * drive[1]; w15 = drive[2] * w1; w16 = R(1.0) - w15; w12 = w12 / w16; w22 = drive[5] * v[2];
 w19 = v[0] + w22; w22 = drive[13] * sigma[0]; w19 = w19 + w22; w6 = drive[14] * v[1]; w19 = w19 + w6; w6 = w12 * w19;
 w21 = drive[0] * v[2]; w21 = drive[4] * w21; w6 = w6 + w21; w24 = drive[11] * sigma[0]; w6 = w6 + w24;
 w7 = drive[12] * w7; w6 = w6 + w7; w6 = sigma[0] * w6; w6 = w6 / drive[16]; w1 = drive[2] - w1; w1 = w1 * drive[1];
 w14 = R(1.0) + w15; w1 = w1 / w14; w15 = w1 * w19; w15 = w15 + w21; w15 = w15 + w24; w15 = w15 + w7;
 w15 = sigma[0] * w15; w15 = w15 / drive[16]; w6 = w6 - w15; w15 = w6 * w6; w15 = w15 / R(4.0); w15 = w15 + R(0.0001);
 w15 = V(sqrt)(w15); w15 = R(2.0) * w15; w7 = lam[0] / w15; w24 = R(0.25) * w7; w21 = sigma[0] * w12;
 w21 = w21 / drive[16]; w27 = sigma[0] * w1; w27 = w27 / drive[16]; w21 = w21 - w27; w27 = R(2.0) * w21;
 w27 = w24 * w27; w6 = R(2.0) * w6; w7 = w7 / w15; w21 = w6 * w21; w21 = R(0.25) * w21; w21 = w21 / w15;
 w21 = R(2.0) * w21; w21 = w7 * w21; w21 = R(0.25) * w21; w21 = w6 * w21; w27 = w27 - w21; w27 = w27 / drive[16];
 w27 = sigma[0] * w27; w21 = w12 * w27; w27 = w1 * w27; w21 = w21 - w27; r0 = w21; w21 = R(0.5) * lam[0];
 w18 = w6 * w24; w27 = w21 - w18; w27 = w27 / drive[16]; w27 = sigma[0] * w27; w9 = R(2.0) * w9; w8 = sign_of(w8);
 w28 = sigma[0] * drive[0]; w28 = w8 * w28; w28 = w28 / drive[10]; w29 = w9 * w28; w29 = w3 * w29; w30 = drive[9] * w29;
 w30 = drive[3] * w30; w31 = drive[1] * w30; w32 = w31 / w14; w33 = w1 / w14; w30 = drive[2] * w30; w34 = w33 * w30;
 w32 = w32 + w34; w34 = w27 * w32; w35 = w12 * drive[14]; w31 = w31 / w16; w36 = w12 / w16; w37 = w36 * w30;
 w31 = w31 + w37; w37 = w19 * w31; w35 = w35 - w37; w25 = drive[12] * drive[0]; w35 = w35 + w25; w35 = sigma[0] * w35;
 w35 = w35 / drive[16]; w37 = w19 * w32; w38 = w1 * drive[14]; w37 = w37 + w38; w37 = w37 + w25; w37 = sigma[0] * w37;
 w37 = w37 / drive[16]; w35 = w35 - w37; w37 = R(2.0) * w35; w37 = w24 * w37; w35 = w6 * w35; w35 = R(0.25) * w35;
 w35 = w35 / w15; w35 = R(2.0) * w35; w35 = w7 * w35; w35 = R(0.25) * w35; w35 = w6 * w35; w37 = w37 - w35;
 w37 = w37 / drive[16]; w37 = sigma[0] * w37; w35 = w1 * w37; w34 = w34 - w35; w35 = w12 * w37; w18 = w18 + w21;
 w18 = w18 / drive[16]; w18 = sigma[0] * w18; w21 = w18 * w31; w35 = w35 - w21; w34 = w34 + w35; r1 = w34;
 w34 = drive[14] * w34; w35 = w19 * w18; w21 = w36 * w35; w25 = w19 * w27; w38 = w33 * w25; w21 = w21 - w38;
 w21 = drive[2] * w21; w38 = w25 / w14; w39 = drive[1] * w38; w21 = w21 - w39; w39 = w35 / w16; w40 = drive[1] * w39;
 w21 = w21 + w40; w21 = drive[3] * w21; w21 = drive[9] * w21; w40 = w3 * w21; w28 = R(2.0) * w28; w40 = w40 * w28;
 w28 = w18 * drive[14]; w37 = w19 * w37; w28 = w28 + w37; w41 = w36 * w28; w31 = w31 / w16; w42 = w36 / w16;
 w42 = w42 * w30; w31 = w31 + w42; w35 = w35 * w31; w41 = w41 - w35; w32 = w32 / w14; w35 = w33 / w14; w35 = w35 * w30;
 w32 = w32 + w35; w25 = w25 * w32; w32 = w27 * drive[14]; w32 = w32 - w37; w37 = w33 * w32; w25 = w25 + w37;
 w41 = w41 - w25; w41 = drive[2] * w41; w32 = w32 / w14; w38 = w38 / w14; w38 = w38 * w30; w32 = w32 + w38;
 w32 = drive[1] * w32; w41 = w41 - w32; w28 = w28 / w16; w39 = w39 / w16; w39 = w39 * w30; w28 = w28 - w39;
 w28 = drive[1] * w28; w41 = w41 + w28; w41 = drive[3] * w41; w41 = drive[9] * w41; w41 = w3 * w41; w21 = w21 * w29;
 w41 = w41 - w21; w41 = w9 * w41; w40 = w40 + w41; w40 = w40 / drive[10]; w40 = w8 * w40; w40 = sigma[0] * w40;
 w40 = drive[0] * w40; w34 = w34 - w40; r2 = w34; w34 = w12 * drive[5]; w23 = drive[4] * drive[0]; w34 = w34 + w23;
 w34 = sigma[0] * w34; w34 = w34 / drive[16]; w40 = w1 * drive[5]; w40 = w40 + w23; w40 = sigma[0] * w40;
 w40 = w40 / drive[16]; w34 = w34 - w40; w40 = R(2.0) * w34; w24 = w24 * w40; w34 = w6 * w34; w34 = R(0.25) * w34;
 w34 = w34 / w15; w34 = R(2.0) * w34; w7 = w7 * w34; w17 = R(0.25) * w7; w6 = w6 * w17; w24 = w24 - w6;
 w24 = w24 / drive[16]; w24 = sigma[0] * w24; w12 = w12 * w24; w1 = w1 * w24; w12 = w12 - w1; r3 = w12;
 w22 = drive[14] * w12; w18 = w18 * drive[5]; w19 = w19 * w24; w18 = w18 + w19; w36 = w36 * w18; w27 = w27 * drive[5];
 w27 = w27 - w19; w33 = w33 * w27; w36 = w36 - w33; w0 = drive[2] * w36; w27 = w27 / w14; w27 = drive[1] * w27;
 w0 = w0 - w27; w18 = w18 / w16; w13 = drive[1] * w18; w0 = w0 + w13; w11 = drive[3] * w0; w2 = drive[9] * w11;
 w3 = w3 * w2; w9 = w9 * w3; w9 = w9 / drive[10]; w8 = w8 * w9; w4 = sigma[0] * w8; w5 = drive[0] * w4; w22 = w22 - w5;
 r4 = w22; w20 = drive[5] * w12; r5 = w20; bend[0] += r0; bend[1] += r1; bend[4] += r2; bend[2] += r3; bend[5] += r4;
 bend[8] += r5;
}

static void antibacklash_screw_coulomb_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, r0, r1; real r2; w1 = V(is)(R(0.0) < sigma[0]); w3 = drive[8] * drive[3];
 w4 = drive[2] - w3; w4 = w4 * drive[1]; w7 = drive[2] * w3; w8 = R(1.0) + w7; w4 = w4 / w8;
 w8 = V(where)(w1 != R(0.0), w4); w9 = V(is)(w1 == R(0.0)); w2 = drive[2] + w3; w2 = w2 * drive[1]; w6 = R(1.0) - w7;
 w2 = w2 / w6; w6 = V(where)(w9 != R(0.0), w2); w8 = w8 + w6; w7 = drive[5] * v[2]; w6 = v[0] + w7;
 w7 = drive[13] * sigma[0]; w6 = w6 + w7; w7 = drive[14] * v[1]; w6 = w6 + w7; w6 = w8 * w6;
 w1 = V(where)(w1 != R(0.0), w2); w9 = V(where)(w9 != R(0.0), w4); w1 = w1 + w9; w9 = w1 * drive[7]; w9 = w9 / drive[0];
 w7 = drive[4] + w9; w5 = drive[0] * v[2]; w7 = w7 * w5; w6 = w6 + w7; w7 = drive[11] * sigma[0]; w1 = w1 - w8;
 w5 = drive[6] * w1; w7 = w7 + w5; w6 = w6 + w7; w4 = drive[0] * v[1]; w7 = drive[12] * w4; w6 = w6 + w7;
 w0 = sigma[0] * w6; w0 = w0 / drive[15]; r0 = w0; r1 = w0; w0 = -w0; r2 = w0; g[0] = r0; g[1] = r1; g[2] = r2;
}

static void antibacklash_screw_coulomb_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11;
 w1 = V(is)(R(0.0) < sigma[0]); w3 = drive[8] * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1]; w7 = drive[2] * w3;
 w8 = R(1.0) + w7; w4 = w4 / w8; w8 = V(where)(w1 != R(0.0), w4); w9 = V(is)(w1 == R(0.0)); w2 = drive[2] + w3;
 w2 = w2 * drive[1]; w6 = R(1.0) - w7; w2 = w2 / w6; w6 = V(where)(w9 != R(0.0), w2); w8 = w8 + w6;
 w3 = drive[5] * v[2]; w6 = v[0] + w3; w3 = drive[13] * sigma[0]; w6 = w6 + w3; w11 = drive[14] * v[1]; w6 = w6 + w11;
 w6 = w8 * w6; w1 = V(where)(w1 != R(0.0), w2); w9 = V(where)(w9 != R(0.0), w4); w1 = w1 + w9; w9 = w1 * drive[7];
 w9 = w9 / drive[0]; w11 = drive[4] + w9; w5 = drive[0] * v[2]; w5 = w11 * w5; w6 = w6 + w5; w5 = drive[11] * sigma[0];
 w1 = w1 - w8; w9 = drive[6] * w1; w5 = w5 + w9; w6 = w6 + w5; w10 = drive[0] * v[1]; w10 = drive[12] * w10;
 w6 = w6 + w10; w6 = sigma[0] * w6; w6 = w6 / drive[15]; r0 = w6; r1 = w6; w6 = -w6; r2 = w6; w6 = sigma[0] * w8;
 w6 = w6 / drive[15]; r3 = w6; r4 = w6; w6 = -w6; r5 = w6; w3 = w8 * drive[14]; w5 = drive[12] * drive[0]; w3 = w3 + w5;
 w3 = sigma[0] * w3; w3 = w3 / drive[15]; r6 = w3; r7 = w3; w3 = -w3; r8 = w3; w8 = w8 * drive[5]; w11 = w11 * drive[0];
 w8 = w8 + w11; w0 = sigma[0] * w8; w0 = w0 / drive[15]; r9 = w0; r10 = w0; w0 = -w0; r11 = w0; g[0] = r0; g[1] = r1;
 g[2] = r2; by[0] = r3; by[3] = r4; by[6] = r5; by[1] = r6; by[4] = r7; by[7] = r8; by[2] = r9; by[5] = r10;
 by[8] = r11;
}

static void antibacklash_screw_coulomb_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 (void)bend; (void)drive; (void)sigma; (void)v; (void)lam;
}

static void antibacklash_screw_coulomb_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, r0; w1 = V(is)(R(0.0) < sigma[0]); w3 = drive[8] * drive[3];
 w4 = drive[2] - w3; w4 = w4 * drive[1]; w7 = drive[2] * w3; w8 = R(1.0) + w7; w4 = w4 / w8;
 w8 = V(where)(w1 != R(0.0), w4); w9 = V(is)(w1 == R(0.0)); w2 = drive[2] + w3; w2 = w2 * drive[1]; w6 = R(1.0) - w7;
 w2 = w2 / w6; w6 = V(where)(w9 != R(0.0), w2); w8 = w8 + w6; w7 = drive[5] * v[2]; w6 = v[0] + w7;
 w7 = drive[13] * sigma[0]; w6 = w6 + w7; w7 = drive[14] * v[1]; w6 = w6 + w7; w6 = w8 * w6;
 w1 = V(where)(w1 != R(0.0), w2); w9 = V(where)(w9 != R(0.0), w4); w1 = w1 + w9; w9 = w1 * drive[7]; w9 = w9 / drive[0];
 w7 = drive[4] + w9; w5 = drive[0] * v[2]; w7 = w7 * w5; w6 = w6 + w7; w7 = drive[11] * sigma[0]; w1 = w1 - w8;
 w5 = drive[6] * w1; w7 = w7 + w5; w6 = w6 + w7; w4 = drive[0] * v[1]; w7 = drive[12] * w4; w6 = w6 + w7;
 w0 = sigma[0] * w6; w0 = w0 / drive[16]; w0 = w0 + R(0.01); r0 = w0; g[0] = r0;
}

static void antibacklash_screw_coulomb_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real r0, r1, r2, r3; w1 = V(is)(R(0.0) < sigma[0]);
 w3 = drive[8] * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1]; w7 = drive[2] * w3; w8 = R(1.0) + w7; w4 = w4 / w8;
 w8 = V(where)(w1 != R(0.0), w4); w9 = V(is)(w1 == R(0.0)); w2 = drive[2] + w3; w2 = w2 * drive[1]; w6 = R(1.0) - w7;
 w2 = w2 / w6; w6 = V(where)(w9 != R(0.0), w2); w8 = w8 + w6; w3 = drive[5] * v[2]; w6 = v[0] + w3;
 w3 = drive[13] * sigma[0]; w6 = w6 + w3; w11 = drive[14] * v[1]; w6 = w6 + w11; w6 = w8 * w6;
 w1 = V(where)(w1 != R(0.0), w2); w9 = V(where)(w9 != R(0.0), w4); w1 = w1 + w9; w9 = w1 * drive[7]; w9 = w9 / drive[0];
 w11 = drive[4] + w9; w5 = drive[0] * v[2]; w5 = w11 * w5; w6 = w6 + w5; w5 = drive[11] * sigma[0]; w1 = w1 - w8;
 w9 = drive[6] * w1; w5 = w5 + w9; w6 = w6 + w5; w10 = drive[0] * v[1]; w10 = drive[12] * w10; w6 = w6 + w10;
 w6 = sigma[0] * w6; w6 = w6 / drive[16]; w6 = w6 + R(0.01); r0 = w6; w0 = sigma[0] / drive[16]; w8 = w8 * w0; r1 = w8;
 w5 = drive[12] * w0; w5 = drive[0] * w5; w3 = drive[14] * w8; w5 = w5 + w3; r2 = w5; w11 = w11 * w0;
 w4 = drive[0] * w11; w7 = drive[5] * w8; w4 = w4 + w7; r3 = w4; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void antibacklash_screw_coulomb_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 (void)bend; (void)drive; (void)sigma; (void)v; (void)lam;
}

static void antibacklash_screw_stribeck_exponential_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w9, w10, w11, w12; real r0, r1, r2; w1 = V(is)(R(0.0) < sigma[0]);
 w9 = drive[0] * v[1]; w10 = sigma[0] * w9; w10 = V(fabs)(w10); w10 = w10 / drive[10]; w6 = (-R(2.0)) * w10;
 w5 = V(exp)(w6); w4 = drive[9] * w5; w3 = drive[8] + w4; w3 = w3 * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1];
 w10 = drive[2] * w3; w11 = R(1.0) + w10; w4 = w4 / w11; w11 = V(where)(w1 != R(0.0), w4); w12 = V(is)(w1 == R(0.0));
 w2 = drive[2] + w3; w2 = w2 * drive[1]; w6 = R(1.0) - w10; w2 = w2 / w6; w6 = V(where)(w12 != R(0.0), w2);
 w11 = w11 + w6; w10 = drive[5] * v[2]; w6 = v[0] + w10; w10 = drive[13] * sigma[0]; w6 = w6 + w10;
 w10 = drive[14] * v[1]; w6 = w6 + w10; w6 = w11 * w6; w1 = V(where)(w1 != R(0.0), w2);
 w12 = V(where)(w12 != R(0.0), w4); w1 = w1 + w12; w12 = w1 * drive[7]; w12 = w12 / drive[0]; w10 = drive[4] + w12;
 w7 = drive[0] * v[2]; w10 = w10 * w7; w6 = w6 + w10; w10 = drive[11] * sigma[0]; w1 = w1 - w11; w7 = drive[6] * w1;
 w10 = w10 + w7; w6 = w6 + w10; w10 = drive[12] * w9; w6 = w6 + w10; w0 = sigma[0] * w6; w0 = w0 / drive[15]; r0 = w0;
 r1 = w0; w0 = -w0; r2 = w0; g[0] = r0; g[1] = r1; g[2] = r2;
}

static void antibacklash_screw_stribeck_exponential_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w8, w9, w10, w11, w13;
 real w14, w15, w16, w17, w18, w19, w21, w22, w23, w24, w25, w26; real w27, r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10;
 real r11; w1 = V(is)(R(0.0) < sigma[0]); w9 = drive[0] * v[1]; w10 = sigma[0] * w9; w11 = V(fabs)(w10);
 w11 = w11 / drive[10]; w11 = (-R(2.0)) * w11; w5 = V(exp)(w11); w11 = drive[9] * w5; w3 = drive[8] + w11;
 w3 = w3 * drive[3]; w13 = drive[2] - w3; w13 = w13 * drive[1]; w16 = drive[2] * w3; w17 = R(1.0) + w16;
 w13 = w13 / w17; w18 = V(where)(w1 != R(0.0), w13); w19 = V(is)(w1 == R(0.0)); w3 = drive[2] + w3; w3 = w3 * drive[1];
 w15 = R(1.0) - w16; w3 = w3 / w15; w16 = V(where)(w19 != R(0.0), w3); w18 = w18 + w16; w22 = drive[5] * v[2];
 w16 = v[0] + w22; w22 = drive[13] * sigma[0]; w16 = w16 + w22; w8 = drive[14] * v[1]; w16 = w16 + w8; w8 = w18 * w16;
 w24 = V(where)(w1 != R(0.0), w3); w25 = V(where)(w19 != R(0.0), w13); w24 = w24 + w25; w26 = w24 * drive[7];
 w26 = w26 / drive[0]; w23 = drive[4] + w26; w21 = drive[0] * v[2]; w26 = w23 * w21; w8 = w8 + w26;
 w26 = drive[11] * sigma[0]; w24 = w24 - w18; w24 = drive[6] * w24; w26 = w26 + w24; w8 = w8 + w26; w9 = drive[12] * w9;
 w8 = w8 + w9; w8 = sigma[0] * w8; w8 = w8 / drive[15]; r0 = w8; r1 = w8; w8 = -w8; r2 = w8; w8 = sigma[0] * w18;
 w8 = w8 / drive[15]; r3 = w8; r4 = w8; w8 = -w8; r5 = w8; w10 = sign_of(w10); w8 = sigma[0] * drive[0]; w10 = w10 * w8;
 w10 = w10 / drive[10]; w6 = (-R(2.0)) * w10; w5 = w5 * w6; w4 = drive[9] * w5; w11 = drive[3] * w4;
 w14 = drive[1] * w11; w4 = w14 / w17; w13 = w13 / w17; w2 = drive[2] * w11; w13 = w13 * w2; w4 = w4 + w13; w4 = -w4;
 w13 = V(where)(w1 != R(0.0), w4); w14 = w14 / w15; w3 = w3 / w15; w3 = w3 * w2; w14 = w14 + w3;
 w3 = V(where)(w19 != R(0.0), w14); w13 = w13 + w3; w16 = w16 * w13; w22 = w18 * drive[14]; w16 = w16 + w22;
 w1 = V(where)(w1 != R(0.0), w14); w19 = V(where)(w19 != R(0.0), w4); w1 = w1 + w19; w25 = drive[7] * w1;
 w25 = w25 / drive[0]; w21 = w21 * w25; w16 = w16 + w21; w1 = w1 - w13; w27 = drive[6] * w1; w16 = w16 + w27;
 w26 = drive[12] * drive[0]; w16 = w16 + w26; w16 = sigma[0] * w16; w16 = w16 / drive[15]; r6 = w16; r7 = w16;
 w16 = -w16; r8 = w16; w18 = w18 * drive[5]; w23 = w23 * drive[0]; w18 = w18 + w23; w0 = sigma[0] * w18;
 w0 = w0 / drive[15]; r9 = w0; r10 = w0; w0 = -w0; r11 = w0; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[3] = r4;
 by[6] = r5; by[1] = r6; by[4] = r7; by[7] = r8; by[2] = r9; by[5] = r10; by[8] = r11;
}

static void antibacklash_screw_stribeck_exponential_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, r0, r1, r2; w1 = lam[1] - lam[2]; w1 = w1 + lam[0]; w1 = w1 / drive[15];
 w1 = sigma[0] * w1; w2 = V(is)(R(0.0) < sigma[0]); w10 = drive[0] * v[1]; w10 = sigma[0] * w10; w11 = V(fabs)(w10);
 w11 = w11 / drive[10]; w11 = (-R(2.0)) * w11; w6 = V(exp)(w11); w10 = sign_of(w10); w11 = sigma[0] * drive[0];
 w11 = w10 * w11; w11 = w11 / drive[10]; w11 = (-R(2.0)) * w11; w11 = w6 * w11; w13 = drive[9] * w11;
 w13 = drive[3] * w13; w14 = drive[1] * w13; w18 = drive[9] * w6; w17 = drive[8] + w18; w17 = w17 * drive[3];
 w18 = drive[2] * w17; w19 = R(1.0) + w18; w20 = w14 / w19; w21 = drive[2] - w17; w21 = w21 * drive[1]; w21 = w21 / w19;
 w21 = w21 / w19; w13 = drive[2] * w13; w22 = w21 * w13; w20 = w20 + w22; w22 = -w20; w23 = V(where)(w2 != R(0.0), w22);
 w24 = V(is)(w2 == R(0.0)); w15 = R(1.0) - w18; w14 = w14 / w15; w17 = drive[2] + w17; w17 = w17 * drive[1];
 w17 = w17 / w15; w17 = w17 / w15; w18 = w17 * w13; w14 = w14 + w18; w18 = V(where)(w24 != R(0.0), w14);
 w23 = w23 + w18; w23 = w1 * w23; r0 = w23; w25 = drive[14] * w23; w26 = drive[6] * w1; w29 = drive[0] * v[2];
 w29 = w29 * w1; w29 = w29 / drive[0]; w29 = drive[7] * w29; w29 = w26 + w29; w30 = V(where)(w2 != R(0.0), w29);
 w28 = drive[5] * v[2]; w31 = v[0] + w28; w28 = drive[13] * sigma[0]; w31 = w31 + w28; w9 = drive[14] * v[1];
 w31 = w31 + w9; w31 = w31 * w1; w31 = w31 - w26; w26 = V(where)(w24 != R(0.0), w31); w30 = w30 + w26; w26 = w30 / w15;
 w9 = drive[1] * w26; w28 = w17 * w30; w29 = V(where)(w24 != R(0.0), w29); w31 = V(where)(w2 != R(0.0), w31);
 w29 = w29 + w31; w31 = w21 * w29; w28 = w28 - w31; w28 = drive[2] * w28; w9 = w9 + w28; w28 = w29 / w19;
 w31 = drive[1] * w28; w9 = w9 - w31; w9 = drive[3] * w9; w9 = drive[9] * w9; w9 = w9 * w11; w18 = w1 * drive[14];
 w11 = w18 / w15; w11 = V(where)(w24 != R(0.0), w11); w26 = w26 / w15; w26 = w26 * w13; w11 = w11 + w26;
 w11 = drive[1] * w11; w26 = w14 / w15; w15 = w17 / w15; w15 = w15 * w13; w26 = w26 + w15; w30 = w30 * w26;
 w17 = w17 * w18; w17 = V(where)(w24 != R(0.0), w17); w30 = w30 + w17; w17 = w21 * w18;
 w17 = V(where)(w2 != R(0.0), w17); w20 = w20 / w19; w21 = w21 / w19; w21 = w21 * w13; w20 = w20 + w21; w29 = w29 * w20;
 w17 = w17 - w29; w30 = w30 - w17; w16 = drive[2] * w30; w11 = w11 + w16; w18 = w18 / w19;
 w18 = V(where)(w2 != R(0.0), w18); w28 = w28 / w19; w28 = w28 * w13; w18 = w18 - w28; w3 = drive[1] * w18;
 w11 = w11 - w3; w4 = drive[3] * w11; w5 = drive[9] * w4; w6 = w6 * w5; w9 = w9 + w6; w7 = (-R(2.0)) * w9;
 w7 = w7 / drive[10]; w10 = w10 * w7; w0 = sigma[0] * w10; w0 = drive[0] * w0; w25 = w25 + w0; r1 = w25;
 w2 = V(where)(w2 != R(0.0), w14); w24 = V(where)(w24 != R(0.0), w22); w2 = w2 + w24; w27 = drive[7] * w2;
 w27 = w27 / drive[0]; w1 = w1 * w27; w8 = drive[0] * w1; w32 = drive[5] * w23; w8 = w8 + w32; r2 = w8; bend[1] += r0;
 bend[4] += r1; bend[5] += r2;
}

static void antibacklash_screw_stribeck_exponential_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w9, w10, w11, w12; real r0; w1 = V(is)(R(0.0) < sigma[0]); w9 = drive[0] * v[1];
 w10 = sigma[0] * w9; w10 = V(fabs)(w10); w10 = w10 / drive[10]; w6 = (-R(2.0)) * w10; w5 = V(exp)(w6);
 w4 = drive[9] * w5; w3 = drive[8] + w4; w3 = w3 * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1];
 w10 = drive[2] * w3; w11 = R(1.0) + w10; w4 = w4 / w11; w11 = V(where)(w1 != R(0.0), w4); w12 = V(is)(w1 == R(0.0));
 w2 = drive[2] + w3; w2 = w2 * drive[1]; w6 = R(1.0) - w10; w2 = w2 / w6; w6 = V(where)(w12 != R(0.0), w2);
 w11 = w11 + w6; w10 = drive[5] * v[2]; w6 = v[0] + w10; w10 = drive[13] * sigma[0]; w6 = w6 + w10;
 w10 = drive[14] * v[1]; w6 = w6 + w10; w6 = w11 * w6; w1 = V(where)(w1 != R(0.0), w2);
 w12 = V(where)(w12 != R(0.0), w4); w1 = w1 + w12; w12 = w1 * drive[7]; w12 = w12 / drive[0]; w10 = drive[4] + w12;
 w7 = drive[0] * v[2]; w10 = w10 * w7; w6 = w6 + w10; w10 = drive[11] * sigma[0]; w1 = w1 - w11; w7 = drive[6] * w1;
 w10 = w10 + w7; w6 = w6 + w10; w10 = drive[12] * w9; w6 = w6 + w10; w0 = sigma[0] * w6; w0 = w0 / drive[16];
 w0 = w0 + R(0.01); r0 = w0; g[0] = r0;
}

static void antibacklash_screw_stribeck_exponential_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, r0, r1, r2, r3; w1 = V(is)(R(0.0) < sigma[0]); w9 = drive[0] * v[1]; w10 = sigma[0] * w9;
 w11 = V(fabs)(w10); w11 = w11 / drive[10]; w11 = (-R(2.0)) * w11; w5 = V(exp)(w11); w11 = drive[9] * w5;
 w3 = drive[8] + w11; w3 = w3 * drive[3]; w13 = drive[2] - w3; w13 = w13 * drive[1]; w16 = drive[2] * w3;
 w17 = R(1.0) + w16; w13 = w13 / w17; w18 = V(where)(w1 != R(0.0), w13); w19 = V(is)(w1 == R(0.0)); w3 = drive[2] + w3;
 w3 = w3 * drive[1]; w15 = R(1.0) - w16; w3 = w3 / w15; w16 = V(where)(w19 != R(0.0), w3); w18 = w18 + w16;
 w22 = drive[5] * v[2]; w16 = v[0] + w22; w22 = drive[13] * sigma[0]; w16 = w16 + w22; w8 = drive[14] * v[1];
 w16 = w16 + w8; w8 = w18 * w16; w24 = V(where)(w1 != R(0.0), w3); w25 = V(where)(w19 != R(0.0), w13); w24 = w24 + w25;
 w26 = w24 * drive[7]; w26 = w26 / drive[0]; w23 = drive[4] + w26; w21 = drive[0] * v[2]; w26 = w23 * w21;
 w8 = w8 + w26; w26 = drive[11] * sigma[0]; w24 = w24 - w18; w24 = drive[6] * w24; w26 = w26 + w24; w8 = w8 + w26;
 w9 = drive[12] * w9; w8 = w8 + w9; w8 = sigma[0] * w8; w8 = w8 / drive[16]; w8 = w8 + R(0.01); r0 = w8;
 w9 = sigma[0] / drive[16]; w18 = w18 * w9; r1 = w18; w22 = drive[14] * w18; w26 = drive[12] * w9; w10 = sign_of(w10);
 w27 = drive[6] * w9; w21 = w21 * w9; w21 = w21 / drive[0]; w25 = drive[7] * w21; w25 = w27 + w25;
 w21 = V(where)(w1 != R(0.0), w25); w16 = w16 * w9; w16 = w16 - w27; w27 = V(where)(w19 != R(0.0), w16);
 w21 = w21 + w27; w27 = w21 / w15; w27 = drive[1] * w27; w3 = w3 / w15; w3 = w3 * w21; w13 = w13 / w17;
 w19 = V(where)(w19 != R(0.0), w25); w1 = V(where)(w1 != R(0.0), w16); w19 = w19 + w1; w13 = w13 * w19; w3 = w3 - w13;
 w2 = drive[2] * w3; w27 = w27 + w2; w19 = w19 / w17; w14 = drive[1] * w19; w27 = w27 - w14; w11 = drive[3] * w27;
 w4 = drive[9] * w11; w5 = w5 * w4; w6 = (-R(2.0)) * w5; w6 = w6 / drive[10]; w10 = w10 * w6; w0 = sigma[0] * w10;
 w26 = w26 + w0; w26 = drive[0] * w26; w22 = w22 + w26; r2 = w22; w23 = w23 * w9; w7 = drive[0] * w23;
 w20 = drive[5] * w18; w7 = w7 + w20; r3 = w7; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void antibacklash_screw_stribeck_exponential_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, r0, r1, r2; w1 = lam[0] / drive[16]; w1 = sigma[0] * w1;
 w2 = V(is)(R(0.0) < sigma[0]); w10 = drive[0] * v[1]; w10 = sigma[0] * w10; w11 = V(fabs)(w10); w11 = w11 / drive[10];
 w11 = (-R(2.0)) * w11; w6 = V(exp)(w11); w10 = sign_of(w10); w11 = sigma[0] * drive[0]; w11 = w10 * w11;
 w11 = w11 / drive[10]; w11 = (-R(2.0)) * w11; w11 = w6 * w11; w13 = drive[9] * w11; w13 = drive[3] * w13;
 w14 = drive[1] * w13; w18 = drive[9] * w6; w17 = drive[8] + w18; w17 = w17 * drive[3]; w18 = drive[2] * w17;
 w19 = R(1.0) + w18; w20 = w14 / w19; w21 = drive[2] - w17; w21 = w21 * drive[1]; w21 = w21 / w19; w21 = w21 / w19;
 w13 = drive[2] * w13; w22 = w21 * w13; w20 = w20 + w22; w22 = -w20; w23 = V(where)(w2 != R(0.0), w22);
 w24 = V(is)(w2 == R(0.0)); w15 = R(1.0) - w18; w14 = w14 / w15; w17 = drive[2] + w17; w17 = w17 * drive[1];
 w17 = w17 / w15; w17 = w17 / w15; w18 = w17 * w13; w14 = w14 + w18; w18 = V(where)(w24 != R(0.0), w14);
 w23 = w23 + w18; w23 = w1 * w23; r0 = w23; w25 = drive[14] * w23; w26 = drive[6] * w1; w29 = drive[0] * v[2];
 w29 = w29 * w1; w29 = w29 / drive[0]; w29 = drive[7] * w29; w29 = w26 + w29; w30 = V(where)(w2 != R(0.0), w29);
 w28 = drive[5] * v[2]; w31 = v[0] + w28; w28 = drive[13] * sigma[0]; w31 = w31 + w28; w9 = drive[14] * v[1];
 w31 = w31 + w9; w31 = w31 * w1; w31 = w31 - w26; w26 = V(where)(w24 != R(0.0), w31); w30 = w30 + w26; w26 = w30 / w15;
 w9 = drive[1] * w26; w28 = w17 * w30; w29 = V(where)(w24 != R(0.0), w29); w31 = V(where)(w2 != R(0.0), w31);
 w29 = w29 + w31; w31 = w21 * w29; w28 = w28 - w31; w28 = drive[2] * w28; w9 = w9 + w28; w28 = w29 / w19;
 w31 = drive[1] * w28; w9 = w9 - w31; w9 = drive[3] * w9; w9 = drive[9] * w9; w9 = w9 * w11; w18 = w1 * drive[14];
 w11 = w18 / w15; w11 = V(where)(w24 != R(0.0), w11); w26 = w26 / w15; w26 = w26 * w13; w11 = w11 + w26;
 w11 = drive[1] * w11; w26 = w14 / w15; w15 = w17 / w15; w15 = w15 * w13; w26 = w26 + w15; w30 = w30 * w26;
 w17 = w17 * w18; w17 = V(where)(w24 != R(0.0), w17); w30 = w30 + w17; w17 = w21 * w18;
 w17 = V(where)(w2 != R(0.0), w17); w20 = w20 / w19; w21 = w21 / w19; w21 = w21 * w13; w20 = w20 + w21; w29 = w29 * w20;
 w17 = w17 - w29; w30 = w30 - w17; w16 = drive[2] * w30; w11 = w11 + w16; w18 = w18 / w19;
 w18 = V(where)(w2 != R(0.0), w18); w28 = w28 / w19; w28 = w28 * w13; w18 = w18 - w28; w3 = drive[1] * w18;
 w11 = w11 - w3; w4 = drive[3] * w11; w5 = drive[9] * w4; w6 = w6 * w5; w9 = w9 + w6; w7 = (-R(2.0)) * w9;
 w7 = w7 / drive[10]; w10 = w10 * w7; w0 = sigma[0] * w10; w0 = drive[0] * w0; w25 = w25 + w0; r1 = w25;
 w2 = V(where)(w2 != R(0.0), w14); w24 = V(where)(w24 != R(0.0), w22); w2 = w2 + w24; w27 = drive[7] * w2;
 w27 = w27 / drive[0]; w1 = w1 * w27; w8 = drive[0] * w1; w32 = drive[5] * w23; w8 = w8 + w32; r2 = w8; bend[1] += r0;
 bend[4] += r1; bend[5] += r2;
}

static void antibacklash_screw_stribeck_gaussian_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w8, w9, w10, w11, w12; real r0, r1, r2; w1 = V(is)(R(0.0) < sigma[0]);
 w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w9 = V(fabs)(w9); w9 = w9 / drive[10]; w9 = w9 * w9; w9 = -w9;
 w5 = V(exp)(w9); w4 = drive[9] * w5; w3 = drive[8] + w4; w3 = w3 * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1];
 w10 = drive[2] * w3; w11 = R(1.0) + w10; w4 = w4 / w11; w11 = V(where)(w1 != R(0.0), w4); w12 = V(is)(w1 == R(0.0));
 w2 = drive[2] + w3; w2 = w2 * drive[1]; w9 = R(1.0) - w10; w2 = w2 / w9; w9 = V(where)(w12 != R(0.0), w2);
 w11 = w11 + w9; w10 = drive[5] * v[2]; w9 = v[0] + w10; w10 = drive[13] * sigma[0]; w9 = w9 + w10;
 w10 = drive[14] * v[1]; w9 = w9 + w10; w9 = w11 * w9; w1 = V(where)(w1 != R(0.0), w2);
 w12 = V(where)(w12 != R(0.0), w4); w1 = w1 + w12; w12 = w1 * drive[7]; w12 = w12 / drive[0]; w10 = drive[4] + w12;
 w6 = drive[0] * v[2]; w10 = w10 * w6; w9 = w9 + w10; w10 = drive[11] * sigma[0]; w1 = w1 - w11; w6 = drive[6] * w1;
 w10 = w10 + w6; w9 = w9 + w10; w10 = drive[12] * w8; w9 = w9 + w10; w0 = sigma[0] * w9; w0 = w0 / drive[15]; r0 = w0;
 r1 = w0; w0 = -w0; r2 = w0; g[0] = r0; g[1] = r1; g[2] = r2;
}

static void antibacklash_screw_stribeck_gaussian_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w7, w8, w9, w10, w12, w13;
 real w14, w15, w16, w17, w18, w19, w21, w22, w23, w24, w25, w26; real w27, r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10;
 real r11; w1 = V(is)(R(0.0) < sigma[0]); w8 = drive[0] * v[1]; w9 = sigma[0] * w8; w10 = V(fabs)(w9);
 w10 = w10 / drive[10]; w12 = w10 * w10; w12 = -w12; w5 = V(exp)(w12); w12 = drive[9] * w5; w3 = drive[8] + w12;
 w3 = w3 * drive[3]; w13 = drive[2] - w3; w13 = w13 * drive[1]; w16 = drive[2] * w3; w17 = R(1.0) + w16;
 w13 = w13 / w17; w18 = V(where)(w1 != R(0.0), w13); w19 = V(is)(w1 == R(0.0)); w3 = drive[2] + w3; w3 = w3 * drive[1];
 w15 = R(1.0) - w16; w3 = w3 / w15; w16 = V(where)(w19 != R(0.0), w3); w18 = w18 + w16; w22 = drive[5] * v[2];
 w16 = v[0] + w22; w22 = drive[13] * sigma[0]; w16 = w16 + w22; w7 = drive[14] * v[1]; w16 = w16 + w7; w7 = w18 * w16;
 w24 = V(where)(w1 != R(0.0), w3); w25 = V(where)(w19 != R(0.0), w13); w24 = w24 + w25; w26 = w24 * drive[7];
 w26 = w26 / drive[0]; w23 = drive[4] + w26; w21 = drive[0] * v[2]; w26 = w23 * w21; w7 = w7 + w26;
 w26 = drive[11] * sigma[0]; w24 = w24 - w18; w24 = drive[6] * w24; w26 = w26 + w24; w7 = w7 + w26; w8 = drive[12] * w8;
 w7 = w7 + w8; w7 = sigma[0] * w7; w7 = w7 / drive[15]; r0 = w7; r1 = w7; w7 = -w7; r2 = w7; w7 = sigma[0] * w18;
 w7 = w7 / drive[15]; r3 = w7; r4 = w7; w7 = -w7; r5 = w7; w10 = R(2.0) * w10; w9 = sign_of(w9);
 w7 = sigma[0] * drive[0]; w9 = w9 * w7; w9 = w9 / drive[10]; w10 = w10 * w9; w5 = w5 * w10; w4 = drive[9] * w5;
 w12 = drive[3] * w4; w14 = drive[1] * w12; w4 = w14 / w17; w13 = w13 / w17; w2 = drive[2] * w12; w13 = w13 * w2;
 w4 = w4 + w13; w13 = V(where)(w1 != R(0.0), w4); w14 = w14 / w15; w3 = w3 / w15; w3 = w3 * w2; w14 = w14 + w3;
 w14 = -w14; w3 = V(where)(w19 != R(0.0), w14); w13 = w13 + w3; w16 = w16 * w13; w22 = w18 * drive[14]; w16 = w16 + w22;
 w1 = V(where)(w1 != R(0.0), w14); w19 = V(where)(w19 != R(0.0), w4); w1 = w1 + w19; w25 = drive[7] * w1;
 w25 = w25 / drive[0]; w21 = w21 * w25; w16 = w16 + w21; w1 = w1 - w13; w27 = drive[6] * w1; w16 = w16 + w27;
 w26 = drive[12] * drive[0]; w16 = w16 + w26; w16 = sigma[0] * w16; w16 = w16 / drive[15]; r6 = w16; r7 = w16;
 w16 = -w16; r8 = w16; w18 = w18 * drive[5]; w23 = w23 * drive[0]; w18 = w18 + w23; w0 = sigma[0] * w18;
 w0 = w0 / drive[15]; r9 = w0; r10 = w0; w0 = -w0; r11 = w0; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[3] = r4;
 by[6] = r5; by[1] = r6; by[4] = r7; by[7] = r8; by[2] = r9; by[5] = r10; by[8] = r11;
}

static void antibacklash_screw_stribeck_gaussian_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, w33, r0, r1, r2; w1 = lam[1] - lam[2]; w1 = w1 + lam[0];
 w1 = w1 / drive[15]; w1 = sigma[0] * w1; w2 = V(is)(R(0.0) < sigma[0]); w9 = drive[0] * v[1]; w9 = sigma[0] * w9;
 w10 = V(fabs)(w9); w10 = w10 / drive[10]; w12 = w10 * w10; w12 = -w12; w6 = V(exp)(w12); w10 = R(2.0) * w10;
 w9 = sign_of(w9); w12 = sigma[0] * drive[0]; w12 = w9 * w12; w12 = w12 / drive[10]; w13 = w10 * w12; w13 = w6 * w13;
 w14 = drive[9] * w13; w14 = drive[3] * w14; w15 = drive[1] * w14; w19 = drive[9] * w6; w18 = drive[8] + w19;
 w18 = w18 * drive[3]; w19 = drive[2] * w18; w20 = R(1.0) + w19; w21 = w15 / w20; w22 = drive[2] - w18;
 w22 = w22 * drive[1]; w22 = w22 / w20; w22 = w22 / w20; w14 = drive[2] * w14; w23 = w22 * w14; w21 = w21 + w23;
 w23 = V(where)(w2 != R(0.0), w21); w24 = V(is)(w2 == R(0.0)); w16 = R(1.0) - w19; w15 = w15 / w16;
 w18 = drive[2] + w18; w18 = w18 * drive[1]; w18 = w18 / w16; w18 = w18 / w16; w19 = w18 * w14; w15 = w15 + w19;
 w19 = -w15; w25 = V(where)(w24 != R(0.0), w19); w23 = w23 + w25; w23 = w1 * w23; r0 = w23; w26 = drive[14] * w23;
 w27 = drive[6] * w1; w30 = drive[0] * v[2]; w30 = w30 * w1; w30 = w30 / drive[0]; w30 = drive[7] * w30;
 w30 = w27 + w30; w31 = V(where)(w2 != R(0.0), w30); w29 = drive[5] * v[2]; w32 = v[0] + w29;
 w29 = drive[13] * sigma[0]; w32 = w32 + w29; w8 = drive[14] * v[1]; w32 = w32 + w8; w32 = w32 * w1; w32 = w32 - w27;
 w27 = V(where)(w24 != R(0.0), w32); w31 = w31 + w27; w27 = w31 / w16; w8 = drive[1] * w27; w29 = w18 * w31;
 w30 = V(where)(w24 != R(0.0), w30); w32 = V(where)(w2 != R(0.0), w32); w30 = w30 + w32; w32 = w22 * w30;
 w29 = w29 - w32; w29 = drive[2] * w29; w8 = w8 + w29; w29 = w30 / w20; w32 = drive[1] * w29; w8 = w8 - w32;
 w8 = drive[3] * w8; w8 = drive[9] * w8; w32 = w6 * w8; w12 = R(2.0) * w12; w32 = w32 * w12; w25 = w1 * drive[14];
 w12 = w25 / w16; w12 = V(where)(w24 != R(0.0), w12); w27 = w27 / w16; w27 = w27 * w14; w12 = w12 - w27;
 w12 = drive[1] * w12; w27 = w18 * w25; w27 = V(where)(w24 != R(0.0), w27); w15 = w15 / w16; w18 = w18 / w16;
 w18 = w18 * w14; w15 = w15 + w18; w31 = w31 * w15; w27 = w27 - w31; w31 = w21 / w20; w15 = w22 / w20; w15 = w15 * w14;
 w31 = w31 + w15; w30 = w30 * w31; w22 = w22 * w25; w22 = V(where)(w2 != R(0.0), w22); w30 = w30 + w22; w27 = w27 - w30;
 w17 = drive[2] * w27; w12 = w12 + w17; w25 = w25 / w20; w25 = V(where)(w2 != R(0.0), w25); w29 = w29 / w20;
 w29 = w29 * w14; w25 = w25 + w29; w3 = drive[1] * w25; w12 = w12 - w3; w4 = drive[3] * w12; w5 = drive[9] * w4;
 w6 = w6 * w5; w8 = w8 * w13; w6 = w6 - w8; w10 = w10 * w6; w32 = w32 + w10; w32 = w32 / drive[10]; w9 = w9 * w32;
 w0 = sigma[0] * w9; w0 = drive[0] * w0; w26 = w26 - w0; r1 = w26; w2 = V(where)(w2 != R(0.0), w19);
 w24 = V(where)(w24 != R(0.0), w21); w2 = w2 + w24; w28 = drive[7] * w2; w28 = w28 / drive[0]; w1 = w1 * w28;
 w7 = drive[0] * w1; w33 = drive[5] * w23; w7 = w7 + w33; r2 = w7; bend[1] += r0; bend[4] += r1; bend[5] += r2;
}

static void antibacklash_screw_stribeck_gaussian_pull_at(const real *drive, const real *sigma, const real *v, real *restrict g)
{
 real w0, w1, w2, w3, w4, w5, w6, w8, w9, w10, w11, w12; real r0; w1 = V(is)(R(0.0) < sigma[0]); w8 = drive[0] * v[1];
 w9 = sigma[0] * w8; w9 = V(fabs)(w9); w9 = w9 / drive[10]; w9 = w9 * w9; w9 = -w9; w5 = V(exp)(w9); w4 = drive[9] * w5;
 w3 = drive[8] + w4; w3 = w3 * drive[3]; w4 = drive[2] - w3; w4 = w4 * drive[1]; w10 = drive[2] * w3;
 w11 = R(1.0) + w10; w4 = w4 / w11; w11 = V(where)(w1 != R(0.0), w4); w12 = V(is)(w1 == R(0.0)); w2 = drive[2] + w3;
 w2 = w2 * drive[1]; w9 = R(1.0) - w10; w2 = w2 / w9; w9 = V(where)(w12 != R(0.0), w2); w11 = w11 + w9;
 w10 = drive[5] * v[2]; w9 = v[0] + w10; w10 = drive[13] * sigma[0]; w9 = w9 + w10; w10 = drive[14] * v[1];
 w9 = w9 + w10; w9 = w11 * w9; w1 = V(where)(w1 != R(0.0), w2); w12 = V(where)(w12 != R(0.0), w4); w1 = w1 + w12;
 w12 = w1 * drive[7]; w12 = w12 / drive[0]; w10 = drive[4] + w12; w6 = drive[0] * v[2]; w10 = w10 * w6; w9 = w9 + w10;
 w10 = drive[11] * sigma[0]; w1 = w1 - w11; w6 = drive[6] * w1; w10 = w10 + w6; w9 = w9 + w10; w10 = drive[12] * w8;
 w9 = w9 + w10; w0 = sigma[0] * w9; w0 = w0 / drive[16]; w0 = w0 + R(0.01); r0 = w0; g[0] = r0;
}

static void antibacklash_screw_stribeck_gaussian_pull_by(const real *drive, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, r0, r1, r2, r3; w1 = V(is)(R(0.0) < sigma[0]); w8 = drive[0] * v[1]; w9 = sigma[0] * w8;
 w10 = V(fabs)(w9); w10 = w10 / drive[10]; w12 = w10 * w10; w12 = -w12; w5 = V(exp)(w12); w12 = drive[9] * w5;
 w3 = drive[8] + w12; w3 = w3 * drive[3]; w13 = drive[2] - w3; w13 = w13 * drive[1]; w16 = drive[2] * w3;
 w17 = R(1.0) + w16; w13 = w13 / w17; w18 = V(where)(w1 != R(0.0), w13); w19 = V(is)(w1 == R(0.0)); w3 = drive[2] + w3;
 w3 = w3 * drive[1]; w15 = R(1.0) - w16; w3 = w3 / w15; w16 = V(where)(w19 != R(0.0), w3); w18 = w18 + w16;
 w22 = drive[5] * v[2]; w16 = v[0] + w22; w22 = drive[13] * sigma[0]; w16 = w16 + w22; w7 = drive[14] * v[1];
 w16 = w16 + w7; w7 = w18 * w16; w24 = V(where)(w1 != R(0.0), w3); w25 = V(where)(w19 != R(0.0), w13); w24 = w24 + w25;
 w26 = w24 * drive[7]; w26 = w26 / drive[0]; w23 = drive[4] + w26; w21 = drive[0] * v[2]; w26 = w23 * w21;
 w7 = w7 + w26; w26 = drive[11] * sigma[0]; w24 = w24 - w18; w24 = drive[6] * w24; w26 = w26 + w24; w7 = w7 + w26;
 w8 = drive[12] * w8; w7 = w7 + w8; w7 = sigma[0] * w7; w7 = w7 / drive[16]; w7 = w7 + R(0.01); r0 = w7;
 w8 = sigma[0] / drive[16]; w18 = w18 * w8; r1 = w18; w22 = drive[14] * w18; w26 = drive[12] * w8; w9 = sign_of(w9);
 w10 = R(2.0) * w10; w27 = drive[6] * w8; w21 = w21 * w8; w21 = w21 / drive[0]; w25 = drive[7] * w21; w25 = w27 + w25;
 w21 = V(where)(w1 != R(0.0), w25); w16 = w16 * w8; w16 = w16 - w27; w27 = V(where)(w19 != R(0.0), w16);
 w21 = w21 + w27; w27 = w21 / w15; w27 = drive[1] * w27; w3 = w3 / w15; w3 = w3 * w21; w13 = w13 / w17;
 w19 = V(where)(w19 != R(0.0), w25); w1 = V(where)(w1 != R(0.0), w16); w19 = w19 + w1; w13 = w13 * w19; w3 = w3 - w13;
 w2 = drive[2] * w3; w27 = w27 + w2; w19 = w19 / w17; w14 = drive[1] * w19; w27 = w27 - w14; w12 = drive[3] * w27;
 w4 = drive[9] * w12; w5 = w5 * w4; w10 = w10 * w5; w10 = w10 / drive[10]; w9 = w9 * w10; w0 = sigma[0] * w9;
 w26 = w26 - w0; w26 = drive[0] * w26; w22 = w22 + w26; r2 = w22; w23 = w23 * w8; w6 = drive[0] * w23;
 w20 = drive[5] * w18; w6 = w6 + w20; r3 = w6; g[0] = r0; by[0] = r1; by[1] = r2; by[2] = r3;
}

static void antibacklash_screw_stribeck_gaussian_pull_bend(const real *drive, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24;
 real w25, w26, w27, w28, w29, w30, w31, w32, w33, r0, r1, r2; w1 = lam[0] / drive[16]; w1 = sigma[0] * w1;
 w2 = V(is)(R(0.0) < sigma[0]); w9 = drive[0] * v[1]; w9 = sigma[0] * w9; w10 = V(fabs)(w9); w10 = w10 / drive[10];
 w12 = w10 * w10; w12 = -w12; w6 = V(exp)(w12); w10 = R(2.0) * w10; w9 = sign_of(w9); w12 = sigma[0] * drive[0];
 w12 = w9 * w12; w12 = w12 / drive[10]; w13 = w10 * w12; w13 = w6 * w13; w14 = drive[9] * w13; w14 = drive[3] * w14;
 w15 = drive[1] * w14; w19 = drive[9] * w6; w18 = drive[8] + w19; w18 = w18 * drive[3]; w19 = drive[2] * w18;
 w20 = R(1.0) + w19; w21 = w15 / w20; w22 = drive[2] - w18; w22 = w22 * drive[1]; w22 = w22 / w20; w22 = w22 / w20;
 w14 = drive[2] * w14; w23 = w22 * w14; w21 = w21 + w23; w23 = V(where)(w2 != R(0.0), w21); w24 = V(is)(w2 == R(0.0));
 w16 = R(1.0) - w19; w15 = w15 / w16; w18 = drive[2] + w18; w18 = w18 * drive[1]; w18 = w18 / w16; w18 = w18 / w16;
 w19 = w18 * w14; w15 = w15 + w19; w19 = -w15; w25 = V(where)(w24 != R(0.0), w19); w23 = w23 + w25; w23 = w1 * w23;
 r0 = w23; w26 = drive[14] * w23; w27 = drive[6] * w1; w30 = drive[0] * v[2]; w30 = w30 * w1; w30 = w30 / drive[0];
 w30 = drive[7] * w30; w30 = w27 + w30; w31 = V(where)(w2 != R(0.0), w30); w29 = drive[5] * v[2]; w32 = v[0] + w29;
 w29 = drive[13] * sigma[0]; w32 = w32 + w29; w8 = drive[14] * v[1]; w32 = w32 + w8; w32 = w32 * w1; w32 = w32 - w27;
 w27 = V(where)(w24 != R(0.0), w32); w31 = w31 + w27; w27 = w31 / w16; w8 = drive[1] * w27; w29 = w18 * w31;
 w30 = V(where)(w24 != R(0.0), w30); w32 = V(where)(w2 != R(0.0), w32); w30 = w30 + w32; w32 = w22 * w30;
 w29 = w29 - w32; w29 = drive[2] * w29; w8 = w8 + w29; w29 = w30 / w20; w32 = drive[1] * w29; w8 = w8 - w32;
 w8 = drive[3] * w8; w8 = drive[9] * w8; w32 = w6 * w8; w12 = R(2.0) * w12; w32 = w32 * w12; w25 = w1 * drive[14];
 w12 = w25 / w16; w12 = V(where)(w24 != R(0.0), w12); w27 = w27 / w16; w27 = w27 * w14; w12 = w12 - w27;
 w12 = drive[1] * w12; w27 = w18 * w25; w27 = V(where)(w24 != R(0.0), w27); w15 = w15 / w16; w18 = w18 / w16;
 w18 = w18 * w14; w15 = w15 + w18; w31 = w31 * w15; w27 = w27 - w31; w31 = w21 / w20; w15 = w22 / w20; w15 = w15 * w14;
 w31 = w31 + w15; w30 = w30 * w31; w22 = w22 * w25; w22 = V(where)(w2 != R(0.0), w22); w30 = w30 + w22; w27 = w27 - w30;
 w17 = drive[2] * w27; w12 = w12 + w17; w25 = w25 / w20; w25 = V(where)(w2 != R(0.0), w25); w29 = w29 / w20;
 w29 = w29 * w14; w25 = w25 + w29; w3 = drive[1] * w25; w12 = w12 - w3; w4 = drive[3] * w12; w5 = drive[9] * w4;
 w6 = w6 * w5; w8 = w8 * w13; w6 = w6 - w8; w10 = w10 * w6; w32 = w32 + w10; w32 = w32 / drive[10]; w9 = w9 * w32;
 w0 = sigma[0] * w9; w0 = drive[0] * w0; w26 = w26 - w0; r1 = w26; w2 = V(where)(w2 != R(0.0), w19);
 w24 = V(where)(w24 != R(0.0), w21); w2 = w2 + w24; w28 = drive[7] * w2; w28 = w28 / drive[0]; w1 = w1 * w28;
 w7 = drive[0] * w1; w33 = drive[5] * w23; w7 = w7 + w33; r2 = w7; bend[1] += r0; bend[4] += r1; bend[5] += r2;
}

static void joint_at(const real *limits, const real *place, const real *curve, const real *x, real *restrict g)
{
 real w0, w1, w2, w3, w7, w8, w9, w10, w11, w12, w13, w14; real w15, w16, w17, r0, r1, r2, r3; w1 = x[0] - place[0];
 w1 = w1 / place[1]; w3 = curve[6] * w1; w3 = w3 + curve[5]; w3 = w3 * w1; w3 = w3 + curve[4]; w3 = w3 * w1;
 w3 = w3 + curve[3]; w3 = w3 * w1; w3 = w3 + curve[2]; w3 = w3 * w1; w3 = w3 + curve[1]; w3 = w3 * w1;
 w3 = w3 + curve[0]; w9 = x[1] / limits[22]; w11 = w3 * w9; r0 = w11; w11 = x[4] / limits[22]; w11 = w3 * w11; r1 = w11;
 w12 = R(6.0) * curve[6]; w12 = w12 * w1; w13 = R(5.0) * curve[5]; w12 = w12 + w13; w12 = w12 * w1;
 w13 = R(4.0) * curve[4]; w12 = w12 + w13; w12 = w12 * w1; w14 = R(3.0) * curve[3]; w12 = w12 + w14; w12 = w12 * w1;
 w7 = R(2.0) * curve[2]; w12 = w12 + w7; w12 = w12 * w1; w12 = w12 + curve[1]; w12 = w12 / place[1]; w8 = w9 * w9;
 w14 = w12 * w8; w16 = limits[22] * limits[22]; w15 = x[2] / w16; w17 = w3 * w15; w14 = w14 + w17; r2 = w14;
 w14 = R(30.0) * curve[6]; w14 = w14 * w1; w0 = R(20.0) * curve[5]; w14 = w14 + w0; w14 = w14 * w1;
 w0 = R(12.0) * curve[4]; w14 = w14 + w0; w14 = w14 * w1; w11 = R(6.0) * curve[3]; w14 = w14 + w11; w14 = w14 * w1;
 w14 = w14 + w7; w2 = place[1] * place[1]; w14 = w14 / w2; w8 = w9 * w8; w14 = w14 * w8; w13 = R(3.0) * w12;
 w13 = w13 * w9; w13 = w13 * w15; w14 = w14 + w13; w10 = limits[22] * w16; w13 = x[3] / w10; w3 = w3 * w13;
 w14 = w14 + w3; r3 = w14; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3;
}

static void joint_by(const real *limits, const real *place, const real *curve, const real *x, real *restrict g, real *restrict by)
{
 real w0, w1, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12;
 real w13, w14, w16, w17, w18, w19, w20, w21, w22, w23, w24, w25;
 real w26, w27, w28, w29, w30, w31, w32, w33, w34, r0, r1, r2; real r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13, r14;
 w1 = x[0] - place[0]; w1 = w1 / place[1]; w3 = curve[6] * w1; w3 = w3 + curve[5]; w5 = w3 * w1; w5 = w5 + curve[4];
 w7 = w5 * w1; w7 = w7 + curve[3]; w9 = w7 * w1; w9 = w9 + curve[2]; w11 = w9 * w1; w11 = w11 + curve[1];
 w13 = w11 * w1; w13 = w13 + curve[0]; w14 = x[1] / limits[22]; w16 = w13 * w14; r0 = w16; w16 = x[4] / limits[22];
 w17 = w13 * w16; r1 = w17; w18 = R(6.0) * curve[6]; w19 = w18 * w1; w20 = R(5.0) * curve[5]; w19 = w19 + w20;
 w20 = w19 * w1; w21 = R(4.0) * curve[4]; w20 = w20 + w21; w21 = w20 * w1; w23 = R(3.0) * curve[3]; w21 = w21 + w23;
 w23 = w21 * w1; w10 = R(2.0) * curve[2]; w23 = w23 + w10; w24 = w23 * w1; w24 = w24 + curve[1]; w24 = w24 / place[1];
 w12 = w14 * w14; w25 = w24 * w12; w27 = limits[22] * limits[22]; w26 = x[2] / w27; w28 = w13 * w26; w25 = w25 + w28;
 r2 = w25; w25 = R(30.0) * curve[6]; w28 = w25 * w1; w29 = R(20.0) * curve[5]; w28 = w28 + w29; w29 = w28 * w1;
 w4 = R(12.0) * curve[4]; w29 = w29 + w4; w4 = w29 * w1; w17 = R(6.0) * curve[3]; w4 = w4 + w17; w17 = w4 * w1;
 w17 = w17 + w10; w10 = place[1] * place[1]; w17 = w17 / w10; w8 = w14 * w12; w6 = w17 * w8; w30 = R(3.0) * w24;
 w31 = w30 * w14; w32 = w31 * w26; w6 = w6 + w32; w33 = limits[22] * w27; w32 = x[3] / w33; w34 = w13 * w32;
 w6 = w6 + w34; r3 = w6; w0 = curve[6] / place[1]; w0 = w1 * w0; w3 = w3 / place[1]; w0 = w0 + w3; w0 = w1 * w0;
 w5 = w5 / place[1]; w0 = w0 + w5; w0 = w1 * w0; w7 = w7 / place[1]; w0 = w0 + w7; w0 = w1 * w0; w9 = w9 / place[1];
 w0 = w0 + w9; w0 = w1 * w0; w11 = w11 / place[1]; w0 = w0 + w11; w11 = w14 * w0; r4 = w11; w16 = w16 * w0; r5 = w16;
 w18 = w18 / place[1]; w18 = w1 * w18; w19 = w19 / place[1]; w18 = w18 + w19; w18 = w1 * w18; w20 = w20 / place[1];
 w18 = w18 + w20; w18 = w1 * w18; w21 = w21 / place[1]; w18 = w18 + w21; w18 = w1 * w18; w23 = w23 / place[1];
 w18 = w18 + w23; w18 = w18 / place[1]; w23 = w12 * w18; w21 = w26 * w0; w23 = w23 + w21; r6 = w23;
 w25 = w25 / place[1]; w25 = w1 * w25; w28 = w28 / place[1]; w25 = w25 + w28; w25 = w1 * w25; w29 = w29 / place[1];
 w25 = w25 + w29; w1 = w1 * w25; w4 = w4 / place[1]; w1 = w1 + w4; w1 = w1 / w10; w8 = w8 * w1; w22 = R(3.0) * w18;
 w22 = w14 * w22; w22 = w26 * w22; w8 = w8 + w22; w32 = w32 * w0; w8 = w8 + w32; r7 = w8; w8 = w13 / limits[22];
 r8 = w8; w32 = R(2.0) * w14; w32 = w32 / limits[22]; w24 = w24 * w32; r9 = w24; w12 = w12 / limits[22];
 w14 = w14 * w32; w12 = w12 + w14; w17 = w17 * w12; w30 = w30 / limits[22]; w26 = w26 * w30; w17 = w17 + w26; r10 = w17;
 w17 = w13 / w27; r11 = w17; w31 = w31 / w27; r12 = w31; w13 = w13 / w33; r13 = w13; r14 = w8; g[0] = r0; g[1] = r1;
 g[2] = r2; g[3] = r3; by[0] = r4; by[5] = r5; by[10] = r6; by[15] = r7; by[1] = r8; by[11] = r9; by[16] = r10;
 by[12] = r11; by[17] = r12; by[18] = r13; by[9] = r14;
}

static void joint_bend(const real *limits, const real *place, const real *curve, const real *x, const real *lam, real *restrict bend)
{
 real w0, w2, w3, w4, w6, w7, w8, w9, w10, w11, w12, w13;
 real w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24, w25;
 real w26, w27, w29, w30, w31, w32, w33, w34, w35, w36, w37, r0; real r1, r2, r3, r4, r5, r6; w0 = x[1] / limits[22];
 w2 = w0 * w0; w3 = w0 * w2; w3 = w3 * lam[3]; w6 = place[1] * place[1]; w3 = w3 / w6; w7 = x[0] - place[0];
 w7 = w7 / place[1]; w8 = R(30.0) * curve[6]; w10 = w8 / place[1]; w11 = w7 * w10; w12 = w8 * w7;
 w13 = R(20.0) * curve[5]; w12 = w12 + w13; w13 = w12 / place[1]; w11 = w11 + w13; w13 = w7 * w11; w15 = w12 * w7;
 w16 = R(12.0) * curve[4]; w15 = w15 + w16; w16 = w15 / place[1]; w13 = w13 + w16; w16 = w3 * w13; w18 = w7 * w3;
 w11 = w18 * w11; w3 = w3 / place[1]; w19 = w15 * w3; w11 = w11 + w19; w16 = w16 + w11; w11 = w7 * w18; w10 = w11 * w10;
 w18 = w18 / place[1]; w3 = w7 * w3; w18 = w18 + w3; w12 = w12 * w18; w10 = w10 + w12; w16 = w16 + w10;
 w11 = w11 / place[1]; w18 = w7 * w18; w11 = w11 + w18; w8 = w8 * w11; w16 = w16 + w8; w18 = limits[22] * limits[22];
 w11 = x[2] / w18; w10 = w11 * lam[3]; w12 = w0 * w10; w12 = R(3.0) * w12; w19 = w2 * lam[2]; w12 = w12 + w19;
 w12 = w12 / place[1]; w20 = R(6.0) * curve[6]; w21 = w20 / place[1]; w22 = w7 * w21; w23 = w20 * w7;
 w24 = R(5.0) * curve[5]; w23 = w23 + w24; w24 = w23 / place[1]; w22 = w22 + w24; w24 = w7 * w22; w25 = w23 * w7;
 w26 = R(4.0) * curve[4]; w25 = w25 + w26; w26 = w25 / place[1]; w24 = w24 + w26; w26 = w7 * w24; w27 = w25 * w7;
 w29 = R(3.0) * curve[3]; w27 = w27 + w29; w29 = w27 / place[1]; w26 = w26 + w29; w29 = w12 * w26; w16 = w16 + w29;
 w29 = w7 * w12; w24 = w29 * w24; w12 = w12 / place[1]; w30 = w27 * w12; w24 = w24 + w30; w16 = w16 + w24;
 w24 = w7 * w29; w22 = w24 * w22; w29 = w29 / place[1]; w12 = w7 * w12; w29 = w29 + w12; w12 = w25 * w29;
 w22 = w22 + w12; w16 = w16 + w22; w22 = w7 * w24; w21 = w22 * w21; w24 = w24 / place[1]; w29 = w7 * w29;
 w24 = w24 + w29; w29 = w23 * w24; w21 = w21 + w29; w16 = w16 + w21; w22 = w22 / place[1]; w24 = w7 * w24;
 w22 = w22 + w24; w22 = w20 * w22; w16 = w16 + w22; w24 = limits[22] * w18; w22 = x[3] / w24; w22 = w22 * lam[3];
 w11 = w11 * lam[2]; w22 = w22 + w11; w11 = x[4] / limits[22]; w11 = w11 * lam[1]; w22 = w22 + w11; w29 = w0 * lam[0];
 w22 = w22 + w29; w29 = curve[6] / place[1]; w12 = w7 * w29; w30 = curve[6] * w7; w30 = w30 + curve[5];
 w14 = w30 / place[1]; w12 = w12 + w14; w14 = w7 * w12; w31 = w30 * w7; w31 = w31 + curve[4]; w17 = w31 / place[1];
 w14 = w14 + w17; w17 = w7 * w14; w32 = w31 * w7; w32 = w32 + curve[3]; w33 = w32 / place[1]; w17 = w17 + w33;
 w33 = w7 * w17; w34 = w32 * w7; w34 = w34 + curve[2]; w36 = w34 / place[1]; w33 = w33 + w36; w36 = w22 * w33;
 w16 = w16 + w36; w36 = w7 * w22; w17 = w36 * w17; w22 = w22 / place[1]; w37 = w34 * w22; w17 = w17 + w37;
 w16 = w16 + w17; w17 = w7 * w36; w14 = w17 * w14; w36 = w36 / place[1]; w22 = w7 * w22; w36 = w36 + w22;
 w22 = w32 * w36; w14 = w14 + w22; w16 = w16 + w14; w14 = w7 * w17; w12 = w14 * w12; w17 = w17 / place[1];
 w36 = w7 * w36; w17 = w17 + w36; w36 = w31 * w17; w12 = w12 + w36; w16 = w16 + w12; w12 = w7 * w14; w29 = w12 * w29;
 w14 = w14 / place[1]; w17 = w7 * w17; w14 = w14 + w17; w17 = w30 * w14; w29 = w29 + w17; w16 = w16 + w29;
 w12 = w12 / place[1]; w14 = w7 * w14; w12 = w12 + w14; w12 = curve[6] * w12; w16 = w16 + w12; w16 = w16 / place[1];
 r0 = w16; w26 = w7 * w26; w16 = w27 * w7; w35 = R(2.0) * curve[2]; w16 = w16 + w35; w12 = w16 / place[1];
 w26 = w26 + w12; w26 = w26 / place[1]; w12 = R(3.0) * w26; w10 = w10 * w12; w13 = w7 * w13; w15 = w15 * w7;
 w19 = R(6.0) * curve[3]; w15 = w15 + w19; w19 = w15 / place[1]; w13 = w13 + w19; w13 = w13 / w6; w13 = lam[3] * w13;
 w2 = w2 * w13; w10 = w10 + w2; w2 = R(2.0) * w0; w13 = w0 * w13; w26 = lam[2] * w26; w13 = w13 + w26; w13 = w2 * w13;
 w10 = w10 + w13; w33 = w7 * w33; w13 = w34 * w7; w13 = w13 + curve[1]; w19 = w13 / place[1]; w33 = w33 + w19;
 w11 = lam[0] * w33; w10 = w10 + w11; w10 = w10 / limits[22]; r1 = w10; w15 = w15 * w7; w15 = w15 + w35; w15 = w15 / w6;
 w15 = w15 * lam[3]; w6 = w2 / limits[22]; w6 = w15 * w6; w35 = w0 * w15; w10 = w16 * w7; w10 = w10 + curve[1];
 w10 = w10 / place[1]; w26 = w10 * lam[2]; w35 = w35 + w26; w26 = R(2.0) / limits[22]; w35 = w35 * w26;
 w15 = w15 / limits[22]; w2 = w2 * w15; w35 = w35 + w2; w6 = w6 + w35; w6 = w6 / limits[22]; r2 = w6; w6 = lam[3] / w18;
 w0 = w0 * w6; w0 = R(3.0) * w0; w0 = w0 / place[1]; w16 = w16 * w0; w0 = w7 * w0; w27 = w27 * w0; w16 = w16 + w27;
 w0 = w7 * w0; w25 = w25 * w0; w16 = w16 + w25; w0 = w7 * w0; w23 = w23 * w0; w16 = w16 + w23; w0 = w7 * w0;
 w20 = w20 * w0; w16 = w16 + w20; w3 = lam[2] / w18; w13 = w13 * w3; w16 = w16 + w13; w3 = w7 * w3; w34 = w34 * w3;
 w16 = w16 + w34; w3 = w7 * w3; w32 = w32 * w3; w16 = w16 + w32; w3 = w7 * w3; w31 = w31 * w3; w16 = w16 + w31;
 w3 = w7 * w3; w30 = w30 * w3; w16 = w16 + w30; w7 = w7 * w3; w9 = curve[6] * w7; w16 = w16 + w9; w16 = w16 / place[1];
 r3 = w16; w8 = R(3.0) * w10; w8 = w8 * w6; w8 = w8 / limits[22]; r4 = w8; w4 = lam[3] * w33; w4 = w4 / w24; r5 = w4;
 w21 = lam[1] * w33; w21 = w21 / limits[22]; r6 = w21; bend[0] += r0; bend[1] += r1; bend[6] += r2; bend[2] += r3;
 bend[7] += r4; bend[3] += r5; bend[4] += r6;
}

static void effort_at(const real *limits, const real *place, const real *curve, const real *x, real *restrict g)
{
 real w0, w1, w2, w4, r0; w1 = x[0] - place[0]; w1 = w1 / place[1]; w0 = curve[6] * w1; w0 = w0 + curve[5];
 w0 = w0 * w1; w0 = w0 + curve[4]; w0 = w0 * w1; w0 = w0 + curve[3]; w0 = w0 * w1; w0 = w0 + curve[2]; w0 = w0 * w1;
 w0 = w0 + curve[1]; w0 = w0 * w1; w0 = w0 + curve[0]; w4 = limits[22] * limits[22]; w2 = x[2] / w4; w0 = w0 * w2;
 w2 = curve[13] * w1; w2 = w2 + curve[12]; w2 = w2 * w1; w2 = w2 + curve[11]; w2 = w2 * w1; w2 = w2 + curve[10];
 w2 = w2 * w1; w2 = w2 + curve[9]; w2 = w2 * w1; w2 = w2 + curve[8]; w2 = w2 * w1; w2 = w2 + curve[7];
 w4 = x[1] / limits[22]; w4 = w4 * w4; w2 = w2 * w4; w0 = w0 + w2; w2 = curve[20] * w1; w2 = w2 + curve[19];
 w2 = w2 * w1; w2 = w2 + curve[18]; w2 = w2 * w1; w2 = w2 + curve[17]; w2 = w2 * w1; w2 = w2 + curve[16]; w2 = w2 * w1;
 w2 = w2 + curve[15]; w2 = w2 * w1; w2 = w2 + curve[14]; w0 = w0 + w2; r0 = w0; g[0] = r0;
}

static void effort_by(const real *limits, const real *place, const real *curve, const real *x, real *restrict g, real *restrict by)
{
 real w0, w1, w3, w4, w5, w6, w7, w8, w9, w11, w12, w13;
 real w14, w15, w16, w17, w18, w19, w20, w21, w22, w23, w24, w25; real w26, w27, w28, r0, r1, r2, r3;
 w1 = x[0] - place[0]; w1 = w1 / place[1]; w3 = curve[6] * w1; w3 = w3 + curve[5]; w4 = w3 * w1; w4 = w4 + curve[4];
 w5 = w4 * w1; w5 = w5 + curve[3]; w6 = w5 * w1; w6 = w6 + curve[2]; w7 = w6 * w1; w7 = w7 + curve[1]; w8 = w7 * w1;
 w8 = w8 + curve[0]; w11 = limits[22] * limits[22]; w9 = x[2] / w11; w12 = w8 * w9; w14 = curve[13] * w1;
 w14 = w14 + curve[12]; w15 = w14 * w1; w15 = w15 + curve[11]; w16 = w15 * w1; w16 = w16 + curve[10]; w17 = w16 * w1;
 w17 = w17 + curve[9]; w18 = w17 * w1; w18 = w18 + curve[8]; w19 = w18 * w1; w19 = w19 + curve[7];
 w20 = x[1] / limits[22]; w21 = w20 * w20; w22 = w19 * w21; w12 = w12 + w22; w23 = curve[20] * w1;
 w23 = w23 + curve[19]; w24 = w23 * w1; w24 = w24 + curve[18]; w25 = w24 * w1; w25 = w25 + curve[17]; w26 = w25 * w1;
 w26 = w26 + curve[16]; w26 = w26 * w1; w27 = w26 + curve[15]; w28 = w27 * w1; w28 = w28 + curve[14]; w12 = w12 + w28;
 r0 = w12; w27 = w27 + w26; w26 = w1 * w1; w25 = w25 * w26; w27 = w27 + w25; w26 = w1 * w26; w24 = w24 * w26;
 w27 = w27 + w24; w26 = w1 * w26; w23 = w23 * w26; w27 = w27 + w23; w26 = w1 * w26; w22 = curve[20] * w26;
 w27 = w27 + w22; w18 = w18 * w21; w27 = w27 + w18; w21 = w1 * w21; w17 = w17 * w21; w27 = w27 + w17; w21 = w1 * w21;
 w16 = w16 * w21; w27 = w27 + w16; w21 = w1 * w21; w15 = w15 * w21; w27 = w27 + w15; w21 = w1 * w21; w14 = w14 * w21;
 w27 = w27 + w14; w21 = w1 * w21; w13 = curve[13] * w21; w27 = w27 + w13; w7 = w7 * w9; w27 = w27 + w7; w9 = w1 * w9;
 w6 = w6 * w9; w27 = w27 + w6; w9 = w1 * w9; w5 = w5 * w9; w27 = w27 + w5; w9 = w1 * w9; w4 = w4 * w9; w27 = w27 + w4;
 w9 = w1 * w9; w3 = w3 * w9; w27 = w27 + w3; w1 = w1 * w9; w0 = curve[6] * w1; w27 = w27 + w0; w27 = w27 / place[1];
 r1 = w27; w20 = R(2.0) * w20; w20 = w20 * w19; w20 = w20 / limits[22]; r2 = w20; w8 = w8 / w11; r3 = w8; g[0] = r0;
 by[0] = r1; by[1] = r2; by[2] = r3;
}

static void effort_bend(const real *limits, const real *place, const real *curve, const real *x, const real *lam, real *restrict bend)
{
 real w0, w1, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12; real w13, w14, w15, w16, w17, w18, w19, w20, w21, r0, r1, r2;
 real r3; w1 = x[0] - place[0]; w1 = w1 / place[1]; w4 = curve[20] / place[1]; w5 = w1 * w4; w6 = curve[20] * w1;
 w6 = w6 + curve[19]; w7 = w6 / place[1]; w5 = w5 + w7; w7 = w1 * w5; w8 = w6 * w1; w8 = w8 + curve[18];
 w9 = w8 / place[1]; w7 = w7 + w9; w9 = w1 * w7; w10 = w8 * w1; w10 = w10 + curve[17]; w11 = w10 / place[1];
 w9 = w9 + w11; w11 = w1 * w9; w12 = w10 * w1; w12 = w12 + curve[16]; w13 = w12 / place[1]; w11 = w11 + w13;
 w11 = lam[0] * w11; w13 = w1 * lam[0]; w9 = w13 * w9; w14 = lam[0] / place[1]; w12 = w12 * w14; w9 = w9 + w12;
 w11 = w11 + w9; w9 = w1 * w13; w7 = w9 * w7; w13 = w13 / place[1]; w14 = w1 * w14; w13 = w13 + w14; w10 = w10 * w13;
 w7 = w7 + w10; w11 = w11 + w7; w7 = w1 * w9; w5 = w7 * w5; w9 = w9 / place[1]; w13 = w1 * w13; w9 = w9 + w13;
 w8 = w8 * w9; w5 = w5 + w8; w11 = w11 + w5; w5 = w1 * w7; w4 = w5 * w4; w7 = w7 / place[1]; w9 = w1 * w9; w7 = w7 + w9;
 w6 = w6 * w7; w4 = w4 + w6; w11 = w11 + w4; w5 = w5 / place[1]; w7 = w1 * w7; w5 = w5 + w7; w3 = curve[20] * w5;
 w11 = w11 + w3; w3 = x[1] / limits[22]; w7 = w3 * w3; w7 = w7 * lam[0]; w6 = curve[13] / place[1]; w9 = w1 * w6;
 w8 = curve[13] * w1; w8 = w8 + curve[12]; w13 = w8 / place[1]; w9 = w9 + w13; w13 = w1 * w9; w10 = w8 * w1;
 w10 = w10 + curve[11]; w14 = w10 / place[1]; w13 = w13 + w14; w14 = w1 * w13; w12 = w10 * w1; w12 = w12 + curve[10];
 w15 = w12 / place[1]; w14 = w14 + w15; w15 = w1 * w14; w16 = w12 * w1; w16 = w16 + curve[9]; w17 = w16 / place[1];
 w15 = w15 + w17; w17 = w7 * w15; w11 = w11 + w17; w17 = w1 * w7; w14 = w17 * w14; w7 = w7 / place[1]; w18 = w16 * w7;
 w14 = w14 + w18; w11 = w11 + w14; w14 = w1 * w17; w13 = w14 * w13; w17 = w17 / place[1]; w7 = w1 * w7; w17 = w17 + w7;
 w12 = w12 * w17; w13 = w13 + w12; w11 = w11 + w13; w13 = w1 * w14; w9 = w13 * w9; w14 = w14 / place[1]; w17 = w1 * w17;
 w14 = w14 + w17; w10 = w10 * w14; w9 = w9 + w10; w11 = w11 + w9; w9 = w1 * w13; w6 = w9 * w6; w13 = w13 / place[1];
 w14 = w1 * w14; w13 = w13 + w14; w8 = w8 * w13; w6 = w6 + w8; w11 = w11 + w6; w9 = w9 / place[1]; w13 = w1 * w13;
 w9 = w9 + w13; w4 = curve[13] * w9; w11 = w11 + w4; w9 = limits[22] * limits[22]; w4 = x[2] / w9; w4 = w4 * lam[0];
 w6 = curve[6] / place[1]; w8 = w1 * w6; w14 = curve[6] * w1; w14 = w14 + curve[5]; w10 = w14 / place[1]; w8 = w8 + w10;
 w10 = w1 * w8; w17 = w14 * w1; w17 = w17 + curve[4]; w12 = w17 / place[1]; w10 = w10 + w12; w12 = w1 * w10;
 w7 = w17 * w1; w7 = w7 + curve[3]; w18 = w7 / place[1]; w12 = w12 + w18; w18 = w1 * w12; w19 = w7 * w1;
 w19 = w19 + curve[2]; w20 = w19 / place[1]; w18 = w18 + w20; w20 = w4 * w18; w11 = w11 + w20; w20 = w1 * w4;
 w12 = w20 * w12; w4 = w4 / place[1]; w21 = w19 * w4; w12 = w12 + w21; w11 = w11 + w12; w12 = w1 * w20; w10 = w12 * w10;
 w20 = w20 / place[1]; w4 = w1 * w4; w20 = w20 + w4; w7 = w7 * w20; w10 = w10 + w7; w11 = w11 + w10; w10 = w1 * w12;
 w8 = w10 * w8; w12 = w12 / place[1]; w20 = w1 * w20; w12 = w12 + w20; w17 = w17 * w12; w8 = w8 + w17; w11 = w11 + w8;
 w8 = w1 * w10; w6 = w8 * w6; w10 = w10 / place[1]; w12 = w1 * w12; w10 = w10 + w12; w14 = w14 * w10; w6 = w6 + w14;
 w11 = w11 + w6; w8 = w8 / place[1]; w10 = w1 * w10; w8 = w8 + w10; w13 = curve[6] * w8; w11 = w11 + w13;
 w11 = w11 / place[1]; r0 = w11; w3 = R(2.0) * w3; w15 = w1 * w15; w16 = w16 * w1; w16 = w16 + curve[8];
 w11 = w16 / place[1]; w15 = w15 + w11; w15 = lam[0] * w15; w3 = w3 * w15; w3 = w3 / limits[22]; r1 = w3;
 w16 = w16 * w1; w16 = w16 + curve[7]; w16 = w16 * lam[0]; w3 = R(2.0) / limits[22]; w16 = w16 * w3;
 w16 = w16 / limits[22]; r2 = w16; w18 = w1 * w18; w19 = w19 * w1; w19 = w19 + curve[1]; w19 = w19 / place[1];
 w18 = w18 + w19; w0 = lam[0] * w18; w0 = w0 / w9; r3 = w0; bend[0] += r0; bend[1] += r1; bend[6] += r2; bend[2] += r3;
}

static void speed_at(const real *limits, const real *place, const real *curve, const real *x, real *restrict g)
{
 real w0, w1, r0; w1 = x[0] - place[0]; w1 = w1 / place[1]; w0 = curve[6] * w1; w0 = w0 + curve[5]; w0 = w0 * w1;
 w0 = w0 + curve[4]; w0 = w0 * w1; w0 = w0 + curve[3]; w0 = w0 * w1; w0 = w0 + curve[2]; w0 = w0 * w1;
 w0 = w0 + curve[1]; w0 = w0 * w1; w0 = w0 + curve[0]; w1 = x[4] / limits[22]; w0 = w0 * w1; r0 = w0; g[0] = r0;
}

static void speed_by(const real *limits, const real *place, const real *curve, const real *x, real *restrict g, real *restrict by)
{
 real w0, w1, w3, w4, w5, w6, w7, w8, w9, w11, r0, r1; real r2; w1 = x[0] - place[0]; w1 = w1 / place[1];
 w3 = curve[6] * w1; w3 = w3 + curve[5]; w4 = w3 * w1; w4 = w4 + curve[4]; w5 = w4 * w1; w5 = w5 + curve[3];
 w6 = w5 * w1; w6 = w6 + curve[2]; w7 = w6 * w1; w7 = w7 + curve[1]; w8 = w7 * w1; w8 = w8 + curve[0];
 w9 = x[4] / limits[22]; w11 = w8 * w9; r0 = w11; w0 = curve[6] / place[1]; w0 = w1 * w0; w3 = w3 / place[1];
 w0 = w0 + w3; w0 = w1 * w0; w4 = w4 / place[1]; w0 = w0 + w4; w0 = w1 * w0; w5 = w5 / place[1]; w0 = w0 + w5;
 w0 = w1 * w0; w6 = w6 / place[1]; w0 = w0 + w6; w1 = w1 * w0; w7 = w7 / place[1]; w1 = w1 + w7; w9 = w9 * w1; r1 = w9;
 w8 = w8 / limits[22]; r2 = w8; g[0] = r0; by[0] = r1; by[4] = r2;
}

static void speed_bend(const real *limits, const real *place, const real *curve, const real *x, const real *lam, real *restrict bend)
{
 real w0, w2, w3, w5, w6, w7, w8, w9, w10, w11, w12, w13; real w14, w15, w16, r0, r1; w0 = x[4] / limits[22];
 w0 = w0 * lam[0]; w3 = x[0] - place[0]; w3 = w3 / place[1]; w6 = curve[6] / place[1]; w7 = w3 * w6; w8 = curve[6] * w3;
 w8 = w8 + curve[5]; w9 = w8 / place[1]; w7 = w7 + w9; w9 = w3 * w7; w10 = w8 * w3; w10 = w10 + curve[4];
 w11 = w10 / place[1]; w9 = w9 + w11; w11 = w3 * w9; w12 = w10 * w3; w12 = w12 + curve[3]; w13 = w12 / place[1];
 w11 = w11 + w13; w13 = w3 * w11; w14 = w12 * w3; w14 = w14 + curve[2]; w15 = w14 / place[1]; w13 = w13 + w15;
 w13 = w0 * w13; w15 = w3 * w0; w11 = w15 * w11; w0 = w0 / place[1]; w16 = w14 * w0; w11 = w11 + w16; w13 = w13 + w11;
 w11 = w3 * w15; w9 = w11 * w9; w15 = w15 / place[1]; w0 = w3 * w0; w15 = w15 + w0; w0 = w12 * w15; w9 = w9 + w0;
 w13 = w13 + w9; w9 = w3 * w11; w7 = w9 * w7; w11 = w11 / place[1]; w15 = w3 * w15; w11 = w11 + w15; w15 = w10 * w11;
 w7 = w7 + w15; w13 = w13 + w7; w7 = w3 * w9; w6 = w7 * w6; w9 = w9 / place[1]; w11 = w3 * w11; w9 = w9 + w11;
 w11 = w8 * w9; w6 = w6 + w11; w13 = w13 + w6; w7 = w7 / place[1]; w9 = w3 * w9; w7 = w7 + w9; w7 = curve[6] * w7;
 w13 = w13 + w7; w13 = w13 / place[1]; r0 = w13; w13 = w14 * w3; w13 = w13 + curve[1]; w2 = lam[0] / limits[22];
 w13 = w13 * w2; w2 = w3 * w2; w14 = w14 * w2; w13 = w13 + w14; w2 = w3 * w2; w12 = w12 * w2; w13 = w13 + w12;
 w2 = w3 * w2; w10 = w10 * w2; w13 = w13 + w10; w2 = w3 * w2; w8 = w8 * w2; w13 = w13 + w8; w3 = w3 * w2;
 w5 = curve[6] * w3; w13 = w13 + w5; w13 = w13 / place[1]; r1 = w13; bend[0] += r0; bend[4] += r1;
}

static void sense_by(const real *bounds, const real *sigma, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, w4, w5, w7, r0, r1, r2, r3, r4; real r5, r6, r7, r8; w1 = sigma[0] * v[0]; w3 = w1 / bounds[0];
 r0 = w3; w4 = R(2.0) * bounds[3]; w3 = v[2] / w4; w5 = w3 * w1; w7 = w5 / bounds[1]; r1 = w7; w7 = sigma[0] * v[1];
 w5 = w5 - w7; w5 = w5 / bounds[1]; r2 = w5; w2 = sigma[0] / bounds[0]; r3 = w2; w3 = w3 * sigma[0];
 w3 = w3 / bounds[1]; r4 = w3; r5 = w3; w0 = sigma[0] / bounds[1]; w0 = -w0; r6 = w0; w1 = w1 / w4; w1 = w1 / bounds[1];
 r7 = w1; r8 = w1; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[3] = r4; by[6] = r5; by[7] = r6; by[5] = r7;
 by[8] = r8;
}

static void sense_bend(const real *bounds, const real *sigma, const real *v, const real *lam, real *restrict bend)
{
 real w0, w1, w3, r0; (void)v; w1 = lam[2] / bounds[1]; w3 = lam[1] / bounds[1]; w1 = w1 + w3; w3 = R(2.0) * bounds[3];
 w1 = w1 / w3; w0 = sigma[0] * w1; r0 = w0; bend[2] += r0;
}

static void pace_by(const real *bounds, const real *v, real *restrict g, real *restrict by)
{
 real w0, w1, w2, w3, r0, r1, r2, r3, r4, r5, r6, r7; w0 = v[0] / bounds[1]; r0 = w0; w2 = v[1] / bounds[2]; r1 = w2;
 w0 = -w0; r2 = w0; w2 = -w2; r3 = w2; w1 = R(1.0) / bounds[1]; r4 = w1; w1 = -w1; r5 = w1; w3 = R(1.0) / bounds[2];
 r6 = w3; w3 = -w3; r7 = w3; g[0] = r0; g[1] = r1; g[2] = r2; g[3] = r3; by[0] = r4; by[4] = r5; by[3] = r6; by[7] = r7;
}

static void state_by(const real *share, const real *z, real *restrict g, real *restrict by)
{
 real w0, w2, w3, w4, w5, w6, w7, w8, w9, r0, r1, r2; real r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13;
 w2 = share[0] * z[4]; w6 = z[2] / R(2.0); w7 = z[3] - z[2]; w7 = share[0] * w7; w8 = w7 / R(6.0); w6 = w6 + w8;
 w8 = w2 * w6; w8 = z[1] + w8; w9 = w2 * w8; w0 = z[0] + w9; r0 = w0; w5 = w7 / R(2.0); w5 = z[2] + w5; w0 = w2 * w5;
 w3 = z[1] + w0; r1 = w3; w4 = z[2] + w7; r2 = w4; r3 = R(1.0); r4 = w2; r5 = R(1.0);
 w3 = R(0.16666666666666666) * share[0]; w0 = R(0.5) - w3; w0 = w2 * w0; w0 = w2 * w0; r6 = w0; w7 = R(0.5) * share[0];
 w0 = R(1.0) - w7; w0 = w2 * w0; r7 = w0; w4 = R(1.0) - share[0]; r8 = w4; w3 = w2 * w3; w3 = w2 * w3; r9 = w3;
 w7 = w2 * w7; r10 = w7; r11 = share[0]; w8 = w8 * share[0]; w6 = w6 * share[0]; w2 = w2 * w6; w8 = w8 + w2; r12 = w8;
 w5 = w5 * share[0]; r13 = w5; g[0] = r0; g[1] = r1; g[2] = r2; by[0] = r3; by[1] = r4; by[6] = r5; by[2] = r6;
 by[7] = r7; by[12] = r8; by[3] = r9; by[8] = r10; by[13] = r11; by[4] = r12; by[9] = r13;
}

static void state_bend(const real *share, const real *z, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w7, w8, r0, r1, r2; real r3; w2 = lam[0] * share[0]; r0 = w2; w3 = lam[1] * share[0];
 w5 = R(0.5) * w3; w7 = share[0] * z[4]; w8 = w7 * lam[0]; w8 = w8 * share[0]; w7 = w7 * w2; w8 = w8 + w7;
 w6 = R(0.16666666666666666) * w8; w5 = w5 + w6; w5 = share[0] * w5; w3 = w3 - w5; w4 = R(0.5) * w8; w3 = w3 + w4;
 r1 = w3; r2 = w5; w3 = z[2] / R(2.0); w4 = z[3] - z[2]; w4 = share[0] * w4; w4 = w4 / R(6.0); w3 = w3 + w4;
 w4 = w3 * share[0]; w0 = lam[0] * w4; w3 = w3 * w2; w0 = w0 + w3; w1 = share[0] * w0; r3 = w1; bend[9] += r0;
 bend[14] += r1; bend[19] += r2; bend[24] += r3;
}

static void line_by(const real *share, const real *hull, const real *z, real *restrict g, real *restrict by)
{
 real w0, w3, w4, w6, w7, w8, w9, w10, w11, w12, w13, w14; real r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11;
 real r12, r13, r14, r15, r16, r17, r18, r19, r20, r21, r22; w3 = share[0] * z[4]; w7 = z[2] / R(2.0); w8 = z[3] - z[2];
 w9 = share[0] * w8; w10 = w9 / R(6.0); w7 = w7 + w10; w10 = w3 * w7; w10 = z[1] + w10; w11 = w3 * w10; w0 = z[0] + w11;
 r0 = w0; w0 = w9 / R(2.0); w0 = z[2] + w0; w11 = w3 * w0; w11 = z[1] + w11; r1 = w11; w9 = z[2] + w9; r2 = w9;
 w8 = w8 / z[4]; r3 = w8; w12 = z[4] * z[2]; w12 = w12 / R(2.0); w4 = z[1] + w12; w4 = w4 - w11; w4 = hull[0] * w4;
 w11 = w11 + w4; r4 = w11; r5 = R(1.0); r6 = w3; r7 = R(1.0); r8 = R(1.0); w12 = R(0.16666666666666666) * share[0];
 w6 = R(0.5) - w12; w6 = w3 * w6; w6 = w3 * w6; r9 = w6; w6 = R(0.5) * share[0]; w13 = R(1.0) - w6; w13 = w3 * w13;
 r10 = w13; w11 = R(1.0) - share[0]; r11 = w11; w11 = R(1.0) / z[4]; w14 = -w11; r12 = w14; w14 = R(0.5) * z[4];
 w14 = w14 - w13; w14 = hull[0] * w14; w13 = w13 + w14; r13 = w13; w12 = w3 * w12; w12 = w3 * w12; r14 = w12;
 w6 = w3 * w6; r15 = w6; r16 = share[0]; r17 = w11; w11 = hull[0] * w6; w6 = w6 - w11; r18 = w6; w10 = w10 * share[0];
 w7 = w7 * share[0]; w3 = w3 * w7; w10 = w10 + w3; r19 = w10; w0 = w0 * share[0]; r20 = w0; w8 = w8 / z[4]; w8 = -w8;
 r21 = w8; w4 = R(0.5) * z[2]; w4 = w4 - w0; w9 = hull[0] * w4; w0 = w0 + w9; r22 = w0; g[0] = r0; g[1] = r1; g[2] = r2;
 g[3] = r3; g[4] = r4; by[0] = r5; by[1] = r6; by[6] = r7; by[21] = r8; by[2] = r9; by[7] = r10; by[12] = r11;
 by[17] = r12; by[22] = r13; by[3] = r14; by[8] = r15; by[13] = r16; by[18] = r17; by[23] = r18; by[4] = r19;
 by[9] = r20; by[19] = r21; by[24] = r22;
}

static void line_bend(const real *share, const real *hull, const real *z, const real *lam, real *restrict bend)
{
 real w0, w1, w2, w3, w4, w5, w6, w8, w9, r0, r1, r2; real r3; w2 = lam[0] * share[0]; r0 = w2; w4 = hull[0] * lam[4];
 w6 = R(0.5) * w4; w5 = lam[4] - w4; w5 = w5 + lam[1]; w5 = w5 * share[0]; w6 = w6 + w5; w5 = R(0.5) * w5;
 w8 = share[0] * z[4]; w9 = w8 * lam[0]; w9 = w9 * share[0]; w8 = w8 * w2; w9 = w9 + w8;
 w4 = R(0.16666666666666666) * w9; w5 = w5 + w4; w5 = share[0] * w5; w8 = lam[3] / z[4]; w8 = w8 / z[4]; w5 = w5 - w8;
 w6 = w6 - w5; w3 = R(0.5) * w9; w6 = w6 + w3; r1 = w6; r2 = w5; w5 = z[3] - z[2]; w3 = w5 / z[4]; w3 = w3 / z[4];
 w3 = w3 / z[4]; w3 = R(2.0) * w3; w4 = lam[3] * w3; w6 = z[2] / R(2.0); w5 = share[0] * w5; w5 = w5 / R(6.0);
 w6 = w6 + w5; w5 = w6 * share[0]; w0 = lam[0] * w5; w6 = w6 * w2; w0 = w0 + w6; w1 = share[0] * w0; w4 = w4 + w1;
 r3 = w4; bend[9] += r0; bend[14] += r1; bend[19] += r2; bend[24] += r3;
}
